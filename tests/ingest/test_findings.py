"""What a finding is: stable codes, each with one meaning; the same after it was written and read."""

from maglev_offline.ingest.checks.codes import CODES
from maglev_offline.ingest.findings import Finding, Place, by_severity, load_findings, save_findings
from maglev_offline.logs.structure import DAMAGES


def finding(code, severity, **more):
    return Finding(code, severity, "signal", "a", "/t", "P1", "what", "todo", **more)


def test_no_code_means_two_things():
    assert not set(CODES) & set(DAMAGES)


def test_the_worst_comes_first():
    given = [finding("b", "info"), finding("c", "error"), finding("a", "warning"), finding("a", "error")]
    assert [(f.severity, f.code) for f in by_severity(given)] == [
        ("error", "a"), ("error", "c"), ("warning", "a"), ("info", "b"),
    ]  # fmt: skip


def test_findings_survive_the_way_to_disk(tmp_path):
    given = [
        finding("a", "error", numbers={"share": 0.5, "n": 3, "signal": "gap"}, count=2, places=(Place(1, 2), Place()))
    ]
    save_findings(given, tmp_path / "findings.json")
    assert load_findings(tmp_path / "findings.json") == given


def test_what_is_no_number_becomes_null(tmp_path):
    save_findings([finding("a", "info", numbers={"x": float("nan"), "y": float("inf")})], tmp_path / "f.json")
    assert load_findings(tmp_path / "f.json")[0].numbers == {"x": None, "y": None}
