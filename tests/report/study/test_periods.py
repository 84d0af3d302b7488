"""The same study at other periods: side by side, and no other study in the place of the recipe's own."""

from pathlib import Path

import pytest

from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.study.periods import periods_section, studies_of
from maglev_offline.workspace import Manifest


def study(period_ms, *, metric="area", difference=-10.0):
    effect = {
        "difference": difference,
        "low": difference - 1,
        "high": difference + 1,
        "baseline_mean": 20.0,
        "verdict": "negative",
    }
    manifest = Manifest("transfer", f"mark {period_ms} {metric}", {})
    manifest.settings = {"mdp": {"control_period_ms": period_ms}, "training": {"seeds": 8, "steps": 1000}}
    manifest.facts = {
        "primary_metric": metric,
        "arms": ["empty", "prefill"],
        "rows": {"prefill": {"rows_from": "log"}},
        "algorithms": {"td3": {"effects": {"prefill": {metric: effect}}}},
    }
    return Evidence({"transfer": Artefact("transfer", Path("transfer"), manifest, "h")})


def test_one_column_for_each_period_in_per_cent_of_its_own_empty_arm():
    evidence = Evidence(study(10).artefacts, {"5ms": study(5, difference=-20.0)})
    (table,) = periods_section(evidence).blocks
    assert list(table.head) == ["arm", "10 ms", "5 ms"]
    assert [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in table.rows[0]] == [
        "prefilled buffer", "−50 (−55 to −45) negative transfer", "−100 (−105 to −95) negative transfer"
    ]  # fmt: skip
    assert "8 seeds of 1,000 decisions (5 s) at 5 ms" in table.caption


@pytest.mark.parametrize("other", [study(10, difference=3.0), study(5, metric="asymptote")])
def test_a_leftover_of_the_own_period_or_of_another_metric_takes_no_place(other):
    evidence = Evidence(study(10).artefacts, {"other": other})
    assert list(studies_of(evidence)) == ["10"]
    assert studies_of(evidence)["10"].facts["algorithms"]["td3"]["effects"]["prefill"]["area"]["difference"] == -10
    assert periods_section(evidence) is None
