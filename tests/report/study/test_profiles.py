"""Profiles and times to the threshold: the shares are those of the runs; many arms are told apart by few lines."""

import numpy as np
import pytest

from maglev_offline.report.study.profiles import profiles_figure, reached_counts, stroke_of
from maglev_offline.report.study.reading import runs_of
from maglev_offline.report.style import ARMS

MANY = [f"arm{k}" for k in range(7)]


@pytest.fixture(scope="module")
def drawn(study):
    study = study.get("transfer")
    figure = profiles_figure(study.facts, runs_of(study), 1_000, 0.95)
    return figure, {(k, line.get_gid()): line for k, ax in enumerate(figure.axes) for line in ax.get_lines()}


def test_profile_is_the_share_of_runs_at_or_below(drawn, study):
    _, lines = drawn
    x, y = lines[0, "profile-good"].get_data()
    runs = runs_of(study.get("transfer")).query("algorithm == 'ddpg' and arm == 'good'")
    middle = np.sort(runs["asymptote"])[5]
    assert y[np.searchsorted(x, middle)] == pytest.approx(6 / 12)
    assert y[0] == 0
    assert y[-1] == 1


def test_every_arm_of_the_recipe_has_a_line_and_no_part_has(drawn):
    figure, lines = drawn
    arms = {gid.removeprefix("profile-") for k, gid in lines if k == 0 and str(gid).startswith("profile-")}
    assert arms == {"empty", "prefill", "good", "bad", "same"}
    assert [len(ax.collections) for ax in figure.axes] == [0, 0, 2, 2]  # bands: the empty and the prefilled buffer


def test_runs_that_never_get_there_stay_at_nothing(drawn):
    _, lines = drawn
    assert lines[2, "reached-bad"].get_ydata().max() == 0
    assert lines[2, "reached-good"].get_ydata()[-1] == 1
    assert lines[2, "reached-good"].get_xdata()[[0, -1]].tolist() == [0, 1_000]


def test_counts_are_those_of_the_runs(study):
    counts = reached_counts(study.get("transfer").facts, "ddpg")
    assert ("good", 12, 12) in counts
    assert ("bad", 0, 12) in counts


def test_of_many_arms_only_the_best_and_the_worst_are_named():
    effects = {arm: {"area": {"difference": float(k)}} for k, arm in enumerate(["prefill", *MANY])}
    facts = {
        "primary_metric": "area",
        "arms": ["empty", "prefill", *MANY],
        "algorithms": {"td3": {"effects": effects}},
    }
    labels = [stroke_of(facts, "td3", arm)[0].label for arm in facts["arms"]]
    assert labels == ["empty buffer", "prefilled buffer", "worst: arm0", *5 * [""], "best: arm6"]
    assert stroke_of(facts, "td3", "prefill")[0] == ARMS["prefill"]
