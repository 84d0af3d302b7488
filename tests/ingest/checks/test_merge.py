"""Findings of windows become findings of the log."""

import pytest

from maglev_offline.ingest.checks import merge
from maglev_offline.ingest.checks.codes import make
from maglev_offline.ingest.findings import MOST_PLACES, Finding, Place


def dropped(missing, of, first=0, topic="t", places=1, **more):
    numbers = {"missing": missing, "of": of, "share": missing / of, "by": "sequence numbers"}
    at = [Place(first_message=first + k, last_message=first + k + 1) for k in range(places)]
    return make("dropped_messages", "log", topic, "p", numbers, places=at, **more)


def test_one_window_stays_as_it_is():
    finding = dropped(1, 100)
    assert merge([finding]) == [finding]


def test_counts_add_and_places_follow_each_other():
    [finding] = merge([dropped(2, 100, 5), dropped(6, 300, 150, places=3)])
    assert finding.count == 4
    assert [place.first_message for place in finding.places] == [5, 150, 151, 152]
    assert finding.numbers == {"missing": 8, "of": 400, "share": pytest.approx(0.02), "by": "sequence numbers"}
    assert "8 (2.00%), in 4 gaps" in finding.what


def test_no_more_places_than_a_finding_may_have():
    [finding] = merge([dropped(80, 100, places=80), dropped(80, 100, 200, places=80)])
    assert len(finding.places) == MOST_PLACES
    assert finding.count == 160


def test_topics_and_signals_stay_apart():
    numbers = {"of": 10, "share": 0.1}
    several = [make("not_finite", "log", "t", "p", {**numbers, "signal": name}) for name in ("gap", "current", "gap")]
    assert [f.numbers["signal"] for f in merge(several)] == ["gap", "current"]
    assert len(merge([dropped(1, 10), dropped(1, 10, topic="other")])) == 2


def test_the_highest_severity_and_the_greatest_of_greatest_stay():
    resets = [make("clock_reset", "l", "t", "p", {"largest_back_s": s}, severity=v) for s, v in
              ((3.0, "info"), (9.0, "error"), (1.0, "warning"))]  # fmt: skip
    [finding] = merge(resets)
    assert finding.severity == "error"
    assert finding.numbers["largest_back_s"] == 9
    assert finding.count == 3


def test_findings_of_others_pass_untouched():
    damage = Finding("trailing_bytes", "warning", "recording", "log", "", "", "Bytes.", "Copy it again.")
    assert merge([damage, damage]) == [damage, damage]
