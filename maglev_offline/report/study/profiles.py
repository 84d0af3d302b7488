"""How runs lie: performance profiles of their final cost, and when they reached the threshold."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, PercentFormatter
from numpy.typing import NDArray

from maglev_offline.report.numbers import NO_BREAK, listing, percent
from maglev_offline.report.study.reading import Facts, arm_label, metric_label, primary_effects
from maglev_offline.report.style import (
    ARMS,
    FULL_WIDTH,
    INK,
    Stroke,
    algorithm_label,
    arm_stroke,
    figure_style,
    log_ticks,
)
from maglev_offline.transfer.distributions import kaplan_meier, performance_profile

Array = NDArray[np.float64]

MOST_COLOURS = 6
"""Of more arms only those of `ARMS`, the best and the worst are told apart."""

_OTHER = "#b4bac1"
_BEST, _WORST = (0, (5, 1.2)), (0, (1, 1.1))


def stroke_of(facts: Facts, algorithm: str, arm: str) -> tuple[Stroke, float]:
    """How an arm is drawn here, and how wide; its label is empty where it is not told apart."""
    if len(facts["arms"]) <= MOST_COLOURS or arm in ARMS:
        return arm_stroke(arm, facts["arms"]), 2.2 if arm in ARMS else 1.4
    ranked = [name for name in primary_effects(facts, algorithm) if name not in ARMS]
    if arm == ranked[0]:
        return Stroke(f"best: {arm}", "#4d4d4d", _BEST), 1.4
    if arm == ranked[-1]:
        return Stroke(f"worst: {arm}", "#4d4d4d", _WORST), 1.6
    return Stroke("", _OTHER), 0.7


def profiles_figure(facts: Facts, runs: pd.DataFrame, steps: int, confidence: float) -> Figure:
    """Performance profiles above, times to the threshold below, a column for each algorithm.

    `runs`: the metrics of every run; `steps`: the length of a run, in environment steps.
    """
    algorithms = list(facts["algorithms"])
    arms = [arm for arm in facts["arms"] if (runs["arm"] == arm).any()]
    shown = runs[runs["arm"].isin(arms)]
    costs = shown["asymptote"].to_numpy(np.float64)
    costs = costs[np.isfinite(costs) & (costs > 0)]
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 6.6), layout="constrained")
        axes = figure.subplots(2, len(algorithms), squeeze=False, sharey=True, sharex="row")
        for (upper, lower), algorithm in zip(axes.T, algorithms, strict=True):
            handles = []
            for arm in arms:
                part = shown[(shown["algorithm"] == algorithm) & (shown["arm"] == arm)]
                stroke, width = stroke_of(facts, algorithm, arm)
                style = {"color": stroke.colour, "linestyle": stroke.dash, "linewidth": width}
                style["zorder"] = 4 if arm in ARMS else 3 if stroke.label else 2
                _profile(upper, part, costs, style, arm)
                _reached(lower, part, steps, confidence, style, arm)
                if stroke.label:
                    handles.append(Line2D([], [], **{**style, "label": stroke.label}))
            if any(not stroke_of(facts, algorithm, arm)[0].label for arm in arms):
                handles.append(Line2D([], [], color=_OTHER, linewidth=0.7, label="other arms"))
            upper.axvline(facts["threshold_cost"], color=INK, linewidth=0.8, linestyle=":", zorder=1)
            upper.legend(handles=handles, loc="lower left", bbox_to_anchor=(0, 1.09), ncols=2, borderaxespad=0)
            upper.set_title(algorithm_label(algorithm))
            upper.set_xlabel("cost at the end of training")
            lower.set_xlabel("environment steps")
        _axes(axes[0, 0], axes[1, 0], costs, steps)
    return figure


def _axes(upper: Axes, lower: Axes, costs: Array, steps: int) -> None:
    """Axes that all panels of a row share."""
    upper.set_xscale("log")
    if len(costs):
        upper.set_xlim(costs.min() / 1.05, costs.max() * 1.05)
    log_ticks(upper, "x")
    low, high = upper.get_xlim()
    if sum(low <= tick <= high for tick in upper.get_xticks()) < 3:
        upper.xaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    upper.set_ylim(-0.02, 1.02)
    upper.yaxis.set_major_formatter(PercentFormatter(1.0, 0, symbol=f"{NO_BREAK}%"))
    upper.set_ylabel("runs that cost no more")
    lower.set_ylabel("runs that reached the threshold")
    lower.set_xlim(0, steps)
    lower.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    lower.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")


def _profile(ax: Axes, part: pd.DataFrame, costs: Array, style: dict[str, Any], arm: str) -> None:
    """One arm's profile: a stair with a step at each of its runs, drawn to the end of the axis."""
    score = part["asymptote"].to_numpy(np.float64)
    own = np.unique(score[np.isfinite(score) & (score > 0)])
    if not len(own):
        return
    at = np.concatenate([[costs.min() / 2], own, [costs.max() * 2]])
    ax.step(at, performance_profile(score, at), where="post", gid=f"profile-{arm}", **style)


def _reached(ax: Axes, part: pd.DataFrame, steps: int, confidence: float, style: dict[str, Any], arm: str) -> None:
    """Kaplan-Meier of one arm, from nothing at the start to the end of a run; a band for the arms of `ARMS`."""
    if not len(part):
        return
    found = kaplan_meier(part["time_to_threshold"].to_numpy(np.float64), part["reached"].to_numpy(bool), confidence)
    at = np.concatenate([[0.0], found.steps, [float(steps)]])
    share, low, high = (np.concatenate([[0.0], side, side[-1:] if len(side) else [0.0]]) for side in found[1:])
    ax.step(at, share, where="post", gid=f"reached-{arm}", **style)
    if arm in ARMS:
        ax.fill_between(at, low, high, step="post", color=style["color"], alpha=0.14, linewidth=0, zorder=1)


def profiles_caption(facts: Facts, confidence: float) -> str:
    """What the figure shows, which arms are told apart, and where it is from."""
    text = (
        "Above: performance profiles, the share of runs whose cost at the end of training (asymptote) is at or below "
        "the one on the axis, which is logarithmic; dotted: the threshold. Below: the share of runs that have reached "
        "the threshold by each step (Kaplan and Meier); runs that never do count as censored at their end; bands: "
        f"{percent(confidence)} intervals of the {_bold(facts)}. Higher is better in both. "
    )
    if len(facts["arms"]) > MOST_COLOURS:
        text += (
            f"Of {len(facts['arms'])} arms, the {_bold(facts)} stand out bold in their colours, and the best "
            f"and the worst other arm of each algorithm, by the mean difference in {metric_label(facts)}, dashed and "
            "dotted; all others are thin and grey. "
        )
    return text + "From transfer (metrics.parquet)."


def _bold(facts: Facts) -> str:
    return listing([arm_label(facts, arm) for arm in facts["arms"] if arm in ARMS])


def reached_counts(facts: Facts, algorithm: str) -> list[tuple[str, int, int]]:
    """Label, runs that reached the threshold, and runs, of each arm that the figure tells apart."""
    found = facts["algorithms"][algorithm]["arms"]
    labels = {arm: stroke_of(facts, algorithm, arm)[0].label for arm in facts["arms"] if arm in found}
    labels = dict(sorted(labels.items(), key=lambda item: item[1].startswith("worst: ")))
    return [
        (label, round(found[arm]["share_reached"] * found[arm]["seeds"]), found[arm]["seeds"])
        for arm, label in labels.items()
        if label
    ]
