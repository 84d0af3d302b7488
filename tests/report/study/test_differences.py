"""All arms against the baseline: order, rows, verdicts, and every seed in the figure."""

import numpy as np

from maglev_offline.report.study.differences import differences_figure, differences_table, spread_over
from maglev_offline.report.study.reading import paired_differences, primary_effects, runs_of
from maglev_offline.report.style import VERDICTS


def test_best_arm_is_on_top(study):
    facts = study.get("transfer").facts
    assert list(primary_effects(facts, "ddpg")) == ["good", "same", "prefill", "bad"]
    assert list(primary_effects(facts, "td3")) == ["same", "prefill", "good", "bad"]


def test_an_arm_without_a_difference_comes_last(study):
    facts = study.get("transfer").facts
    found = facts["algorithms"]["ddpg"]["effects"]
    none = {**found["good"], "area": {**found["good"]["area"], "difference": None}}
    facts = {**facts, "algorithms": {"ddpg": {"effects": {**found, "good": none}}}}
    assert list(primary_effects(facts, "ddpg")) == ["same", "prefill", "bad", "good"]


def test_table_says_what_was_planted(study):
    table = differences_table(study.get("transfer").facts, 0.95)
    assert len(table.rows) == 8
    first = dict(zip(table.head, table.rows[0], strict=True))
    assert first["arm"] == "DDPG, good"
    assert first["rows"] == "1,234"
    assert abs(float(first["mean difference"]) - 6) < 0.3
    assert first["seeds better"] == "100\N{NO-BREAK SPACE}%"
    assert first["interquartile mean (interval)"].count("\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}") == 1
    assert [row[-1] for row in table.rows[:4]] == ["positive transfer", "equivalent", *2 * ["negative transfer"]]
    assert list(table.marks[:4]) == ["positive", "equivalent", "negative", "negative"]
    assert table.caption.endswith("From transfer (manifest.json).")


def test_differences_are_paired_by_seed(study):
    runs = runs_of(study.get("transfer"))
    shuffled = runs.sample(frac=1, random_state=1)
    found = paired_differences(shuffled, "td3", "area")
    of = runs[runs["algorithm"] == "td3"].set_index(["arm", "seed"])["area"]
    np.testing.assert_allclose(found.loc[3, "bad"], of["empty", 3] - of["bad", 3])
    assert "empty" not in found.columns


def test_figure_has_every_seed_and_the_interval_in_the_verdicts_colour(study):
    study = study.get("transfer")
    figure = differences_figure(study.facts, runs_of(study))
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["DDPG", "TD3"]
    ax = figure.axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["good", "same", "prefilled buffer", "bad"]
    dots = {line.get_gid(): line for line in ax.get_lines() if str(line.get_gid()).startswith("seeds-")}
    assert len(dots) == 4
    np.testing.assert_allclose(
        dots["seeds-good"].get_xdata(), paired_differences(runs_of(study), "ddpg", "area")["good"]
    )
    means = [line for line in ax.get_lines() if len(line.get_xdata()) == 1]
    assert [line.get_color() for line in means] == [
        VERDICTS[v] for v in ("positive", "equivalent", "negative", "negative")
    ]
    assert ax.get_xscale() == "symlog"  # 12 is more than 12 margins of 0.5
    assert "logarithmic" in ax.get_xlabel()


def test_jitter_is_within_the_row_and_keeps_dots_apart():
    offsets = spread_over(50)
    assert np.abs(offsets).max() <= 0.3
    assert np.diff(np.sort(offsets)).min() > 0.003
    np.testing.assert_array_equal(offsets[:20], spread_over(20))
