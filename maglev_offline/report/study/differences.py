"""Every seed of every arm against the baseline: a figure, and the same numbers as a table."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from maglev_offline.report import words
from maglev_offline.report.numbers import interval, number, percent, whole
from maglev_offline.report.page import Table
from maglev_offline.report.study.axes import WIDE, about_zero, draw_effect, margin_band, verdict_handles
from maglev_offline.report.study.reading import (
    Facts,
    arm_label,
    metric_label,
    metric_unit,
    paired_differences,
    primary_effects,
    seeds_of,
)
from maglev_offline.report.style import FULL_WIDTH, INK, SOFT, VERDICTS, algorithm_label, figure_style

DOT = "#9aa3ac"
MOST_VECTOR_DOTS = 1_500
"""More dots are drawn as pixels, so that the page stays light."""


def differences_figure(facts: Facts, runs: pd.DataFrame) -> Figure:
    """Paired differences (empty minus arm) in the primary metric, a panel for each algorithm, best arm on top.

    `runs`: the metrics of every run. Dots: seeds; bold: mean and interval of the manifest, in the verdict's colour.
    """
    algorithms = list(facts["algorithms"])
    effects = {algorithm: primary_effects(facts, algorithm) for algorithm in algorithms}
    most = max(map(len, effects.values()), default=0)
    pixels = most * len(algorithms) * seeds_of(facts) > MOST_VECTOR_DOTS
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 1.3 + 0.27 * most), layout="constrained")
        axes = figure.subplots(1, len(algorithms), squeeze=False)[0]
        drawn = [_draw(ax, facts, runs, algorithm, pixels) for ax, algorithm in zip(axes, algorithms, strict=True)]
        margin = max((effect["margin"] for arms in effects.values() for effect in arms.values()), default=0.0)
        for ax in axes:  # one scale for all, so that algorithms compare
            scale = about_zero(ax, "x", [value for part in drawn for value in part], margin)
            what = f"difference in {metric_unit(facts)}"
            ax.set_xlabel(f"← harms{WIDE}{what}{WIDE}helps →" + scale.replace(" ", "\n", 1))
            ax.xaxis.label.set_color(SOFT)
        verdicts = [effect["verdict"] for arms in effects.values() for effect in arms.values()]
        seed = Line2D([], [], color=DOT, marker="o", markersize=3, linewidth=0, label="one seed")
        handles = [seed, *verdict_handles(verdicts)]
        figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), columnspacing=1.6)
    return figure


def _draw(ax: Axes, facts: Facts, runs: pd.DataFrame, algorithm: str, pixels: bool) -> list[float]:
    """Draw the arms of one algorithm; return all that must fit on the axis."""
    effects = primary_effects(facts, algorithm)
    seeds = paired_differences(runs, algorithm, facts["primary_metric"])
    values: list[float] = []
    for y, (arm, effect) in enumerate(effects.items()):
        dots = seeds[arm].to_numpy(np.float64)
        ax.plot(
            dots,
            y + spread_over(len(dots)),
            "o",
            markersize=2.6,
            color=DOT,
            markeredgewidth=0,
            alpha=0.75,
            zorder=2,
            rasterized=pixels,
            gid=f"seeds-{arm}",
        )
        values += [*dots, *(effect[end] for end in ("low", "high") if effect[end] is not None)]
        if effect["difference"] is not None:
            colour = VERDICTS[effect["verdict"]]
            draw_effect(ax, y, effect["low"], effect["high"], effect["difference"], effect["verdict"], colour)
    if effects:
        margin_band(ax, next(iter(effects.values()))["margin"])
    ax.set_yticks(range(len(effects)), [arm_label(facts, arm) for arm in effects], color=INK)
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(len(effects) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.spines["left"].set_visible(False)
    ax.set_title(algorithm_label(algorithm))
    return values


def spread_over(count: int) -> NDArray[np.float64]:
    """Offsets [count] within 0.3 of a row that keep dots apart: steps of the golden ratio, no random draws."""
    golden = (np.sqrt(5) - 1) / 2
    offsets: NDArray[np.float64] = 0.6 * ((golden * np.arange(count) + 0.5) % 1 - 0.5)
    return offsets


def differences_caption(facts: Facts, confidence: float) -> str:
    """What the figure shows and where it is from."""
    return (
        f"Paired differences in {metric_label(facts)} (empty minus arm) of every seed, best arm on top: to the right "
        f"the arm is better. Bold: the mean with its {percent(confidence)} bootstrap interval, filled where the "
        "interval decides. Grey band: the margin within which a difference does not matter. From transfer "
        "(manifest.json; seeds: metrics.parquet)."
    )


def differences_table(facts: Facts, confidence: float) -> Table:
    """All arms of all algorithms in the order of the figure, each with its effect in the primary metric."""
    rows, marks = [], []
    for algorithm in facts["algorithms"]:
        for arm, effect in primary_effects(facts, algorithm).items():
            middle = number(effect["interquartile"])
            if effect["interquartile_low"] is not None:
                middle += f" ({interval(effect['interquartile_low'], effect['interquartile_high'])})"
            rows.append(
                [
                    f"{algorithm_label(algorithm)}, {arm_label(facts, arm)}",
                    whole(facts["rows"].get(arm, {}).get("rows")),
                    number(effect["difference"]),
                    interval(effect["low"], effect["high"]),
                    middle,
                    percent(effect["probability_better"]),
                    number(effect["p_value_holm"], 2),
                    words.verdict_words(facts, arm, effect["verdict"]),
                ]
            )
            marks.append(effect["verdict"])
    head = ["arm", "rows", "mean difference", f"{percent(confidence)} interval", "interquartile mean (interval)"]
    head += ["seeds better", "p (Holm)", "verdict"]
    caption = (
        f"Effects of all arms on {metric_label(facts)}, in {metric_unit(facts)}: empty minus arm, paired by seed, over "
        f"{words.seeds_words(seeds_of(facts))}. Rows: in the buffer at the start. Seeds better: their share, ties "
        "counted half. p: by changes of sign, corrected by Holm over all algorithms, arms and metrics; the verdict is "
        "the interval’s, without correction. From transfer (manifest.json)."
    )
    return Table(caption, head, rows, marks=marks, sources=("transfer",))


def against_table(facts: Facts, confidence: float) -> Table:
    """Arms held against each other, where the recipe asks for it."""
    rows, marks = [], []
    for told in facts["against"]["comparisons"]:
        rows.append(
            [
                f"{algorithm_label(told['algorithm'])}, {arm_label(facts, told['arm'])}",
                arm_label(facts, told["against"]),
                number(told["difference"]),
                interval(told["low"], told["high"]),
                percent(told["probability_better"]),
                number(told["p_value_holm"], 2),
                words.CONTROL_WORDS[told["verdict"]],
            ]
        )
        marks.append(told["verdict"])
    head = [
        "arm",
        "against",
        "mean difference",
        f"{percent(confidence)} interval",
        "seeds better",
        "p (Holm)",
        "the arm is",
    ]
    caption = (
        f"Arms held against each other in {metric_label(facts)}, paired by seed: the other minus the arm, so that a "
        "positive difference means that the arm is better. p: corrected by Holm over these comparisons. From transfer "
        "(manifest.json)."
    )
    return Table(caption, head, rows, labels=2, marks=marks, sources=("transfer",))
