"""Figures of learning: the cost over training, and what prefill changed in it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from maglev_offline.report.figures_control import legend_above
from maglev_offline.report.numbers import interval, number
from maglev_offline.report.style import (
    FULL_WIDTH,
    INK,
    RULE,
    SOFT,
    VERDICTS,
    Stroke,
    algorithm_label,
    arm_stroke,
    controller_stroke,
    figure_style,
    log_ticks,
)

METRIC_LABELS = {
    "jumpstart": "jumpstart",
    "asymptote": "asymptote",
    "area": "area",
    "time_to_threshold": "time to threshold",
}
"""The metrics of transfer, as readers call them."""

REFERENCES = ("pid", "lqr_held", "lqi")


def curves_figure(
    curves: pd.DataFrame,
    reference: Mapping[str, float],
    threshold: float | None,
    exploratory_steps: int | None,
    drawn: Sequence[str] = (),
) -> Figure:
    """Evaluation cost over environment steps, a panel for each algorithm: seeds thin, median bold, quartiles shaded.

    `drawn`: the arms to draw, where they are not all; each has the colour that it has among all of them.
    """
    algorithms = list(dict.fromkeys(curves["algorithm"]))
    arms = list(dict.fromkeys(curves["arm"]))
    drawn = list(drawn) or arms
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 4.0), layout="constrained")
        axes = figure.subplots(1, len(algorithms), sharex=True, sharey=True, squeeze=False)[0]
        for ax, algorithm in zip(axes, algorithms, strict=True):
            for arm in drawn:
                part = curves[(curves["algorithm"] == algorithm) & (curves["arm"] == arm)]
                if len(part):
                    _draw_arm(ax, part, arm, arms)
            for name in (name for name in REFERENCES if name in reference):
                stroke = controller_stroke(name)
                ax.axhline(reference[name], color=stroke.colour, linestyle=stroke.dash, linewidth=1.0, zorder=2)
            if threshold is not None:
                ax.axhline(threshold, color=INK, linewidth=0.8, linestyle=":", zorder=2)
            if exploratory_steps:
                ax.axvspan(0, exploratory_steps, color="#f1f3f5", linewidth=0, zorder=0)
            ax.set_title(algorithm_label(algorithm))
            ax.set_xlabel("environment steps")
        _axis(axes[0], curves)
        strokes = [arm_stroke(arm, arms) for arm in drawn]
        strokes += [controller_stroke(name) for name in REFERENCES if name in reference]
        if threshold is not None:
            strokes.append(Stroke("threshold", INK, ":"))
        legend_above(figure, strokes)
    return figure


def _axis(ax: Axes, curves: pd.DataFrame) -> None:
    ax.set_yscale("log")
    ax.set_ylabel("mean cost of an evaluation episode")
    ax.set_xlim(0, int(curves["env_step"].max()))
    ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    log_ticks(ax, "y")


def _draw_arm(ax: Axes, part: pd.DataFrame, arm: str, arms: list[str]) -> None:
    stroke = arm_stroke(arm, arms)
    table = part.pivot(index="env_step", columns="seed", values="cost")
    steps, cost = table.index.to_numpy(), table.to_numpy()
    thin = max(0.15, min(0.5, 3 / cost.shape[1]))
    for seed, line in zip(table.columns, cost.T, strict=True):
        ax.plot(steps, line, color=stroke.colour, linewidth=0.5, alpha=thin, gid=f"cost-{arm}-seed-{seed}")
    low, middle, high = np.quantile(cost, [0.25, 0.5, 0.75], axis=1)
    ax.fill_between(steps, low, high, color=stroke.colour, alpha=0.15, linewidth=0)
    ax.plot(steps, middle, color=stroke.colour, linestyle=stroke.dash, linewidth=1.9, zorder=3)


def forest_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Paired differences with their intervals, as a share of the empty arm's mean, so that all metrics share one axis.

    A point to the right of zero means that the arm's rows help. The grey box of a row is the margin within which its
    difference does not matter.
    """
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 0.9 + 0.34 * len(rows)), layout="constrained")
        ax = figure.subplots()
        ax.grid(axis="y", visible=False)
        margins = [row["margin"] for row in rows]
        ax.barh(range(len(rows)), [2 * m for m in margins], left=[-m for m in margins], height=0.8, color="#e6e8eb")
        ax.axvline(0, color=INK, linewidth=0.8, zorder=1)
        for y, row in enumerate(rows):
            colour = VERDICTS[row["verdict"]]
            if row["low"] is not None:
                ax.hlines(y, row["low"], row["high"], color=colour, linewidth=2.2, gid=f"interval-{y}")
            filled = row["verdict"] in ("positive", "negative")
            ax.plot(
                row["difference"], y, "o", markersize=6, color=colour, markerfacecolor=colour if filled else "white"
            )
            ax.annotate(
                row["text"], (1.01, y), xycoords=("axes fraction", "data"), va="center", fontsize=8.5, color=colour
            )  # fmt: skip
        ax.set_yticks(range(len(rows)), [row["label"] for row in rows], color=INK)
        ax.tick_params(axis="y", length=0)
        ax.set_ylim(len(rows) - 0.4, -0.6)
        for y in range(1, len(rows)):
            if rows[y]["group"] != rows[y - 1]["group"]:
                ax.axhline(y - 0.5, color=RULE, linewidth=0.8)
        ax.spines["left"].set_visible(False)
        gap = "\u2003" * 2
        scale = _symmetric(ax, min(margins, default=0.0))
        what = f"difference, % of the mean with an empty buffer{scale}"
        ax.set_xlabel(f"← the rows harm{gap}{what}{gap}the rows help →")
        ax.xaxis.label.set_color(SOFT)
    return figure


def sorted_metrics(effects: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """The effects in the order in which a run goes: its start, its end, the whole, the threshold."""
    known = [(metric, effects[metric]) for metric in METRIC_LABELS if metric in effects]
    return known + [(metric, effect) for metric, effect in effects.items() if metric not in METRIC_LABELS]


def _symmetric(ax: Axes, margin: float) -> str:
    """Put zero in the middle; where the effects dwarf the margin, compress the axis, and say so in words."""
    reach = max(abs(side) for side in ax.get_xlim())
    compressed = margin > 0 and reach > 12 * margin
    if compressed:
        ax.set_xscale("symlog", linthresh=2 * margin, linscale=0.8)
        margin = float(f"{margin:.1g}")
        places = [p for p in (3, 10, 30, 100, 300, 1_000, 3_000, 10_000, 100_000) if 2 * margin <= p <= reach]
        ax.set_xticks([*(-p for p in reversed(places)), 0, *places])
        ax.minorticks_off()
    ax.set_xlim(-1.05 * reach, 1.05 * reach)
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:+,g}".replace("-", "−") if value else "0")
    return f" (logarithmic beyond ±{2 * margin:g})" if compressed else ""


def forest_rows(verdict: Mapping[str, Any], arms: Sequence[str]) -> list[dict[str, Any]]:
    """One row for each algorithm, arm (of `arms`) and metric of the verdict, in per cent of the baseline's mean."""
    rows = []
    for algorithm, found in verdict["algorithms"].items():
        for arm in (arm for arm in arms if arm in found["effects"]):
            for metric, effect in sorted_metrics(found["effects"][arm]):
                base = abs(effect["baseline_mean"])
                if not base:  # a share of nothing is no number
                    continue
                share = {
                    k: None if effect[k] is None else 100 * effect[k] / base for k in ("difference", "low", "high")
                }
                several = len(arms) > 1
                name = f"{algorithm_label(algorithm)}{f' ({arm})' if several else ''}"
                rows.append(
                    {
                        **share,
                        "label": f"{name}  {METRIC_LABELS.get(metric, metric)}",
                        "group": (algorithm, arm),
                        "margin": 100 * effect["margin"] / base,
                        "verdict": effect["verdict"],
                        "text": f"{number(effect['difference'])}  ({interval(effect['low'], effect['high'])})",
                    }
                )
    return rows
