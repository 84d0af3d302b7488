"""Figures of regulation: how classical controllers and agents bring the magnet back to the set-point."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from maglev_offline.report.style import (
    FULL_WIDTH,
    SOFT,
    Stroke,
    algorithm_label,
    arm_stroke,
    controller_stroke,
    figure_style,
)

_ROWS = (("gap_m", "gap, mm", 1e3), ("voltage_v", "voltage, V", 1.0), ("current_a", "current, A", 1.0))

MOST_VECTOR_POINTS = 8_000
"""Arms with more points than this have their single seeds drawn as pixels, so that the page stays small."""


MOST_IN_A_ROW = 8
"""A legend with more names than this goes over two rows, or it leaves the figure."""


def regulation_figure(
    classical: pd.DataFrame | None,
    agents: pd.DataFrame | None,
    set_point_m: float,
    duration_s: float,
    study_arms: Sequence[str] = (),
) -> Figure:
    """Gap, voltage and current over the first `duration_s`: classical controllers, then each algorithm's arms.

    `classical`: responses with `controller`; `agents`: responses with `algorithm`, `arm`, `seed`. Each seed is a thin
    line, the median over the seeds at each instant a bold one. `study_arms`: all arms, where `agents` holds some of
    them, so that each keeps its colour.
    """
    algorithms = [] if agents is None else list(dict.fromkeys(agents["algorithm"]))
    columns = ([] if classical is None else ["classical"]) + algorithms
    alone = len(columns) == 1  # one column of panels becomes one row
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 2.6 if alone else 6.4), layout="constrained")
        shape = (1, len(_ROWS)) if alone else (len(_ROWS), len(columns))
        axes = figure.subplots(*shape, sharex=True, sharey="none" if alone else "row", squeeze=False)
        axes = axes.T if alone else axes
        for column, name in enumerate(columns):
            for row, (signal, label, scale) in enumerate(_ROWS):
                ax = axes[row, column]
                if name == "classical" and classical is not None:
                    _draw_classical(ax, classical, signal, scale)
                elif agents is not None:
                    _draw_agents(ax, agents[agents["algorithm"] == name], signal, scale, study_arms)
                if signal == "gap_m":
                    ax.axhline(1e3 * set_point_m, color=SOFT, linewidth=0.7, linestyle=":", zorder=1)
                if column == 0:
                    ax.set_ylabel(label)
                if alone or row == len(_ROWS) - 1:
                    ax.set_xlabel("time, s")
            axes[0, column].set_title("classical controllers" if name == "classical" else algorithm_label(name))
        axes[0, 0].set_xlim(0, duration_s)
        for ax in axes[:, 0]:
            ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        if not alone:
            figure.align_ylabels(axes[:, 0])
        names = [] if classical is None else list(dict.fromkeys(classical["controller"]))
        arms = [] if agents is None else list(dict.fromkeys(agents["arm"]))
        strokes = [controller_stroke(name) for name in names] + [arm_stroke(arm, study_arms or arms) for arm in arms]
        legend_above(figure, strokes, set_point=True)
    return figure


def long_response_figure(
    classical: pd.DataFrame, set_point_m: float, names: Sequence[str] = ("pid", "cascade")
) -> Figure:
    """Gap over the whole stored response: what the slow controllers do after the first half second."""
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 2.2), layout="constrained")
        ax = figure.subplots()
        shown = [name for name in names if name in set(classical["controller"])]
        _draw_classical(ax, classical[classical["controller"].isin(shown)], "gap_m", 1e3)
        ax.axhline(1e3 * set_point_m, color=SOFT, linewidth=0.7, linestyle=":", zorder=1)
        ax.set_xlim(0, float(classical["t_s"].max()))
        ax.set_xlabel("time, s")
        ax.set_ylabel("gap, mm")
        legend_above(figure, [controller_stroke(name) for name in shown], set_point=True)
    return figure


def legend_above(figure: Figure, strokes: Sequence[Stroke], *, set_point: bool = False) -> None:
    """Put one legend above all panels, where it can cover no data."""
    handles = [Line2D([], [], color=s.colour, linestyle=s.dash, linewidth=1.8, label=s.label) for s in strokes]
    if set_point:
        handles.append(Line2D([], [], color=SOFT, linewidth=0.9, linestyle=":", label="set-point"))
    rows = -(-len(handles) // MOST_IN_A_ROW)
    columns = -(-len(handles) // rows)
    figure.legend(handles=handles, loc="outside upper left", ncols=columns, handlelength=2.6, columnspacing=1.6)


def _draw_classical(ax: Axes, responses: pd.DataFrame, signal: str, scale: float) -> None:
    for name, rows in responses.groupby("controller", sort=False):
        stroke = controller_stroke(str(name))
        ax.plot(
            rows["t_s"], scale * rows[signal], color=stroke.colour, linestyle=stroke.dash, gid=f"{signal}-{name}"
        )  # fmt: skip


def _draw_agents(ax: Axes, responses: pd.DataFrame, signal: str, scale: float, study_arms: Sequence[str]) -> None:
    arms = list(dict.fromkeys(responses["arm"]))
    for arm in arms:
        stroke = arm_stroke(arm, study_arms or arms)
        table = responses[responses["arm"] == arm].pivot(index="t_s", columns="seed", values=signal) * scale
        t, values = table.index.to_numpy(), table.to_numpy()
        thin = max(0.18, min(0.6, 3 / values.shape[1]))
        for seed, line in zip(table.columns, values.T, strict=True):
            (drawn,) = ax.plot(t, line, color=stroke.colour, linewidth=0.6, alpha=thin)
            drawn.set(gid=f"{signal}-{arm}-seed-{seed}", rasterized=values.size > MOST_VECTOR_POINTS)
        ax.plot(t, np.median(values, axis=1), color=stroke.colour, linestyle=stroke.dash, linewidth=1.9, zorder=3)
