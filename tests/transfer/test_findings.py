"""The tables of a study for a document: the numbers of its manifest, and nothing that it does not say."""

import json

import pytest

from maglev_offline.transfer.findings import arms_table, main, parts_table


def effect(difference, verdict, *, holds=False):
    return {
        "difference": difference,
        "low": difference - 1,
        "high": difference + 1,
        "baseline_mean": 23.0,
        "verdict": verdict,
        "holds_after_holm": holds,
    }


@pytest.fixture
def facts():
    runs = {"seeds": 20, "share_settled": 0.95}
    effects = {"area": effect(-13.35, "negative", holds=True), "asymptote": effect(0.01, "equivalent")}
    diagnostic = {"verdict": "harmful", "error_over_advantage_std": 2.7, "correlation_with_advantage": -0.12}
    part = {"algorithm": "td3", "share_of_rows": 0.57, "difference": 8.0, "low": 6.0, "high": 10.0}
    return {
        "primary_metric": "area",
        "arms": ["empty", "prefill"],
        "rows": {"prefill": {"diagnostic": diagnostic}},
        "algorithms": {"td3": {"arms": {"empty": runs, "prefill": runs}, "effects": {"prefill": effects}}},
        "attribution": {
            "parts": [
                {**part, "part": "log-3", "meaning": "harms", "holds_after_holm": True},
                {**part, "part": "log-1", "meaning": "not known", "holds_after_holm": False},
            ]
        },
    }


def test_every_arm_has_its_rows_and_effects_and_bold_ones_hold_after_holm(facts):
    lines = arms_table(facts).split("\n")
    assert lines[2] == "| `empty`: mean |  | 23.00 | 23.00 | 19 of 20 |"
    assert lines[3] == (
        "| `prefill` | harmful: 2.70, -0.12 | **-13.35 (-14.35 to -12.35) negative** | "
        "+0.01 (-0.99 to +1.01) equivalent | 19 of 20 |"
    )


def test_only_parts_that_hold_after_holm_are_told(facts):
    assert parts_table(facts).split("\n")[2:] == ["| log-3 | 57% | **+8.00 (+6.00 to +10.00) harms** |"]


def test_the_document_gets_the_tables_that_it_has_markers_for(facts, tmp_path):
    home = tmp_path / "reports" / "study" / "periods" / "5ms"
    home.mkdir(parents=True)
    (home / "manifest.json").write_text(json.dumps({"artefact": "transfer", "facts": facts}))
    document = tmp_path / "findings.md"
    document.write_text("<!-- study of study periods/5ms: begin -->\n<!-- study of study periods/5ms: end -->\n")
    assert main([str(document), str(tmp_path / "reports")]) == 0
    assert arms_table(facts) in document.read_text()


def test_a_table_whose_study_is_gone_is_no_silent_leftover(tmp_path, capsys):
    document = tmp_path / "findings.md"
    document.write_text("<!-- study of gone: begin -->\n<!-- study of gone: end -->\n")
    assert main([str(document), str(tmp_path)]) == 2
    assert "no study 'gone'" in capsys.readouterr().err


def test_bad_arguments_are_told_and_no_traceback(tmp_path, capsys):
    assert main([str(tmp_path / "none.md"), str(tmp_path)]) == 2
    assert "Usage" in capsys.readouterr().err
