"""The diagnostic against the outcome: every arm with a number is a point, and the text says what the interval says."""

import pytest

from maglev_offline.report.study.foretelling import (
    calibration_table,
    foretelling_figure,
    foretelling_sentences,
    points_of,
)
from maglev_offline.report.study.reading import runs_of


def test_points_are_arms_with_a_target_error(study, with_facts):
    runs, facts = runs_of(study.get("transfer")), study.get("transfer").facts
    points = {point.arm: point for point in points_of(facts, runs, "ddpg")}
    assert len(points) == 8
    assert points["bad"].difference == pytest.approx(-12, abs=0.3)
    assert points["bad"].named
    assert not points["prefill-without-log-1"].named
    rows = {**facts["rows"], "bad": {**facts["rows"]["bad"], "diagnostic": None}}
    assert len(points_of(with_facts(rows=rows).get("transfer").facts, runs, "ddpg")) == 7


def test_sentences_follow_the_interval(study, with_facts):
    def said(correlation, interval):
        told = {"rank_correlation": correlation, "interval": interval, "arms": 9, "groups": 9}
        facts = {"foretelling": {"algorithms": {"td3": {"error_over_advantage_std": told}}}}
        return foretelling_sentences(facts, 0.95)[0]

    assert said(-0.8, (-0.9, -0.3)).endswith("the arms whose rows err more do worse.")
    assert said(0.8, (0.3, 0.9)).endswith("the arms whose rows err more do better.")
    assert said(-0.2, (-0.6, 0.3)).endswith("the interval holds zero, so nothing is shown to be foretold.")
    assert said(None, None) == "With TD3, 9 arms with a target error are too few for a rank correlation."


def test_calibration_counts_all_arms(study):
    table = calibration_table(study.get("transfer").facts)
    assert [row[0] for row in table.rows] == ["rows judged fit", "rows judged harmful"]
    fit = dict(zip(table.head, table.rows[0], strict=True))
    assert (fit["positive"], fit["equivalent"], fit["negative"], fit["all"]) == ("1", "2", "1", "4")
    assert table.rows[1][-1] == "12"


def test_names_do_not_overlap_and_an_error_of_zero_is_shown(study):
    study = study.get("transfer")
    figure = foretelling_figure(study.facts, runs_of(study))
    for ax in figure.axes:
        boxes = [text.get_window_extent() for text in ax.texts]
        assert {text.get_text() for text in ax.texts} <= {"prefilled buffer", "good", "bad", "same"}
        assert len(boxes) >= 3
        assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    left = figure.axes[0].get_xticks()[0]
    assert figure.axes[0].xaxis.get_major_formatter()(left, 0) == "0"
