"""Did the diagnostic of an arm's rows, known before any training, foretell what they did?"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter

from maglev_offline.curate.diagnostic import FIT_ERROR, HARMFUL_ERROR
from maglev_offline.report.numbers import interval, number, percent, whole
from maglev_offline.report.page import Table
from maglev_offline.report.study.axes import WIDE, about_zero, margin_band
from maglev_offline.report.study.names import Spot, name_spots
from maglev_offline.report.study.reading import (
    Facts,
    arm_label,
    metric_label,
    metric_unit,
    paired_differences,
    primary_effects,
)
from maglev_offline.report.style import (
    FULL_WIDTH,
    SOFT,
    VERDICTS,
    algorithm_label,
    figure_style,
    log_ticks,
)

NUMBER = "error_over_advantage_std"
BEFORE = {
    "fit": (VERDICTS["positive"], "o"),
    "doubtful": ("#6e7781", "s"),
    "harmful": (VERDICTS["negative"], "^"),
}
"""Colour and marker of each verdict before training."""

AFTER = ("positive", "equivalent", "inconclusive", "negative")


class Point(NamedTuple):
    """One arm: the target error of its rows, what it did, the verdict before, and whether the recipe names it."""

    arm: str
    error: float
    difference: float
    verdict: str
    named: bool


def points_of(facts: Facts, runs: pd.DataFrame, algorithm: str) -> list[Point]:
    """All arms whose rows have a target error: those of the recipe in its order, then those of the attribution.

    `runs`: the metrics of every run.
    """
    means = paired_differences(runs, algorithm, facts["primary_metric"]).mean(skipna=False)
    found = []
    for arm, rows in facts["rows"].items():
        told = rows.get("diagnostic")
        if arm in means.index and told is not None and told[NUMBER] is not None and np.isfinite(means[arm]):
            found.append(Point(arm, float(told[NUMBER]), float(means[arm]), told["verdict"], arm in facts["arms"]))
    order = {arm: place for place, arm in enumerate(facts["arms"])}
    return sorted(found, key=lambda point: (order.get(point.arm, len(order)), point.arm))


def foretelling_figure(facts: Facts, runs: pd.DataFrame) -> Figure:
    """Target error of an arm's rows against its mean difference, a panel for each algorithm, colour by the verdict."""
    points = {algorithm: points_of(facts, runs, algorithm) for algorithm in facts["algorithms"]}
    everything = [point for part in points.values() for point in part]
    margins = [effect["margin"] for name in points for effect in primary_effects(facts, name).values()]
    margin = max(margins, default=0.0)
    floor = _floor([point.error for point in everything])
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 4.6), layout="constrained")
        axes = figure.subplots(1, len(points), squeeze=False, sharex=True, sharey=True)[0]
        for ax, (algorithm, part) in zip(axes, points.items(), strict=True):
            margin_band(ax, margin, "y")
            for edge in (FIT_ERROR, HARMFUL_ERROR):
                ax.axvline(edge, color=SOFT, linewidth=0.7, linestyle=":", zorder=1)
            for point in part:
                colour, marker = BEFORE[point.verdict]
                size, alpha = (6.5, 0.95) if point.named else (3.2, 0.55)
                ax.plot(
                    max(point.error, floor), point.difference, marker, color=colour, markersize=size, alpha=alpha,
                    markeredgewidth=0, zorder=3 if point.named else 2,
                )  # fmt: skip
            ax.set_title(algorithm_label(algorithm))
            ax.set_xlabel("error of the targets, over spread of advantage")
        scale = about_zero(axes[0], "y", [point.difference for point in everything], margin, most=4)
        what = f"← harms{WIDE}mean difference in {metric_unit(facts)}{WIDE}helps →"
        axes[0].set_ylabel(what + scale.replace(" ", "\n", 1))
        _error_axis(axes[0], [point.error for point in everything], floor)
        figure.legend(
            handles=_handles(everything), loc="outside upper left", ncols=4, columnspacing=1.6, handletextpad=0.3
        )
        spots = [
            [Spot(max(p.error, floor), p.difference, arm_label(facts, p.arm) if p.named else "") for p in part]
            for part in points.values()
        ]
        name_spots(figure, axes, spots)
    return figure


def _floor(errors: Sequence[float]) -> float:
    """Where an error of zero is drawn on a logarithmic axis: left of all others."""
    positive = [error for error in errors if error > 1e-9]
    return min(positive, default=1.0) / 3


def _error_axis(ax: Axes, errors: Sequence[float], floor: float) -> None:
    ax.set_xscale("log")
    zero = min(errors, default=1.0) < floor
    low, high = (floor if zero else min(errors, default=1.0)), max([*errors, floor])
    ax.set_xlim(low / 1.4, max(1.6 * high, 1.3 * HARMFUL_ERROR))
    log_ticks(ax, "x")
    if zero:
        plain = ax.xaxis.get_major_formatter()
        places = [float(place) for place in ax.get_xticks() if place > 1.5 * floor]
        ax.xaxis.set_major_locator(FixedLocator([floor, *places]))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda x, at: "0" if x <= 1.01 * floor else plain(x, at)))


def _handles(points: Sequence[Point]) -> list[Line2D]:
    seen = {point.verdict for point in points}
    handles = [
        Line2D(
            [],
            [],
            color=colour,
            marker=marker,
            markersize=6.5,
            markeredgewidth=0,
            linewidth=0,
            label=f"rows judged {word}",
        )
        for word, (colour, marker) in BEFORE.items()
        if word in seen
    ]
    if any(not point.named for point in points):
        small = Line2D([], [], color=SOFT, marker="o", markersize=3.2, markeredgewidth=0, linewidth=0)
        small.set_label("small: a part left out")
        handles.append(small)
    return handles


def foretelling_sentences(facts: Facts, confidence: float) -> list[str]:
    """For each algorithm the rank correlation of the target error with the outcome, and its interval."""
    found = []
    for algorithm, numbers in facts["foretelling"]["algorithms"].items():
        told = numbers[NUMBER]
        name, arms = algorithm_label(algorithm), told["arms"]
        if told["rank_correlation"] is None:
            found.append(
                f"With {name}, {arms} arm{'s' * (arms != 1)} with a target error are too few for a rank correlation."
            )
            continue
        low, high = told["interval"]
        way = "the arms whose rows err more do worse" if high < 0 else "the arms whose rows err more do better"
        said = way if low * high > 0 else "the interval holds zero, so nothing is shown to be foretold"
        found.append(
            f"With {name}, the rank correlation of the rows’ target error with the mean difference over {arms} arms, "
            f"in {told['groups']} groups that share their rows, is "
            f"{number(told['rank_correlation'], 2)} ({percent(confidence)} interval {interval(low, high, 2)}): {said}."
        )
    return found


def _between(told: Facts) -> str:
    low, high = told["interval"] or (None, None)
    return interval(low, high, 2)


def foretelling_caption(facts: Facts, confidence: float) -> str:
    """What the figure shows, with the rank correlations, and where it is from."""
    told = [
        f"{algorithm_label(name)} {number(found[NUMBER]['rank_correlation'], 2)} "
        f"({_between(found[NUMBER])}; {found[NUMBER]['arms']} arms)"
        for name, found in facts["foretelling"]["algorithms"].items()
    ]
    return (
        "The target error of the rows that an arm starts with, known before training, against its mean difference in "
        f"{metric_label(facts)} (empty minus arm). Names: the arms of the recipe, where there is room; small: a part "
        f"of the rows left out. Dotted: rows are fit up to {FIT_ERROR:g} and harmful from {HARMFUL_ERROR:g} on, or by "
        "their correlation, with the whole of the interval. Grey band: the margin. Rank correlation "
        f"({percent(confidence)} interval over groups of arms that share their rows): {'; '.join(told)}. From "
        "transfer (manifest.json; differences: metrics.parquet)."
    )


def calibration_table(facts: Facts) -> Table:
    """How often each verdict before training met each outcome."""
    counts = facts["foretelling"]["calibration"]
    after = [word for word in AFTER if any(word in row for row in counts.values())]
    rows = [
        [
            f"rows judged {before}",
            *(whole(counts[before].get(word, 0)) for word in after),
            whole(sum(counts[before].values())),
        ]
        for before in BEFORE
        if before in counts
    ]
    caption = (
        "The verdict on the rows before training against the outcome after it: numbers of arms, over all algorithms, "
        f"those with a part of the rows left out included; outcomes in {metric_label(facts)} against the empty buffer. "
        "From transfer (manifest.json)."
    )
    return Table(caption, ["before training", *after, "all"], rows, sources=("transfer",))
