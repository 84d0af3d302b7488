"""Figures of the logged data: a stretch of a log, the coverage of the state-action space, the prefill."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import blended_transform_factory
from numpy.typing import NDArray

from maglev_offline.report.style import (
    FULL_WIDTH,
    QUARANTINE,
    RULE,
    SIGNALS,
    SOFT,
    algorithm_label,
    figure_style,
    log_ticks,
)

Array = NDArray[np.float64]


MOST_VECTOR_POINTS = 10_000
"""A longer stretch is drawn as pixels, so that the page stays small."""

BANDS = ("#eef1f4", "#f6f7f9")
"""Backgrounds of segments, by turns."""


class Window(NamedTuple):
    """A stretch of one log: its rows of the samples, and the times of what was quarantined in it, both in seconds."""

    rows: pd.DataFrame
    quarantined_s: Array
    start_s: float
    duration_s: float
    seams: int


_SIGNALS = (
    ("gap_m", "gap, mm", 1e3),
    ("gap_velocity_m_s", "gap velocity,\nmm/s", 1e3),
    ("current_a", "current, A", 1.0),
    ("voltage_v", "voltage, V", 1.0),
)


def trajectory_window(samples: pd.DataFrame, quarantine: pd.DataFrame, point: str, duration_s: float) -> Window:
    """Choose the stretch of one log and point to draw.

    It is the stretch around the end of a segment that holds most of what was quarantined (the first of equals), or the
    beginning where there is no such end.
    """
    rows = samples[samples["point"] == point].sort_values(["segment", "step"], kind="stable")
    t = _seconds(rows["t"], rows["t"].min())
    q = quarantine[(quarantine["point"] == point) | (quarantine["point"] == "")]
    put_aside = np.sort(_seconds(q["t"].dropna(), rows["t"].min()))
    follows = (np.diff(rows["segment"].to_numpy()) == 0) if len(rows) > 1 else np.empty(0, dtype=bool)
    seams = np.sort(t[1:][~follows])
    starts = np.clip(seams - 0.4 * duration_s, 0.0, max(0.0, float(t.max()) - duration_s))
    held = np.searchsorted(put_aside, starts + duration_s, side="right") - np.searchsorted(put_aside, starts)
    start = float(starts[np.argmax(held)]) if len(seams) else 0.0
    inside = (t >= start) & (t <= start + duration_s)
    rows = rows.assign(t_s=t)[inside]
    near = put_aside[(put_aside >= start) & (put_aside <= start + duration_s)]
    return Window(rows, near, start, duration_s, int(((seams > start) & (seams <= start + duration_s)).sum()))


def _seconds(t: pd.Series, origin: pd.Timestamp) -> Array:
    return np.asarray((t - origin).dt.total_seconds(), dtype=np.float64)


def trajectory_figure(window: Window) -> Figure:
    """Gap with set-point, gap velocity, current and voltage over time; segments as bands, quarantined as marks."""
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 5.4), layout="constrained")
        axes = figure.subplots(len(_SIGNALS), 1, sharex=True)
        segments = [rows for _, rows in window.rows.groupby("segment", sort=True)]
        for ax, (name, label, scale) in zip(axes, _SIGNALS, strict=True):
            for number, rows in enumerate(segments):
                t = rows["t_s"].to_numpy()
                ax.axvspan(t[0], t[-1], color=BANDS[number % 2], linewidth=0, zorder=0)
                (line,) = ax.plot(t, scale * rows[name], color=SIGNALS["logged"], linewidth=1.0)
                line.set(gid=f"{name}-{number}", rasterized=len(window.rows) > MOST_VECTOR_POINTS)
                if name == "gap_m":
                    ax.plot(t, scale * rows["set_point_m"], color=SIGNALS["set_point"], linewidth=0.9, linestyle="--")
            if len(window.quarantined_s):
                base = blended_transform_factory(ax.transData, ax.transAxes)
                ax.vlines(window.quarantined_s, 0, 0.12, color=QUARANTINE, linewidth=0.8, transform=base)
            ax.set_ylabel(label)
            ax.margins(y=0.12)
        axes[-1].set_xlim(window.start_s, window.start_s + window.duration_s)
        axes[-1].set_xlabel("time since the first sample of the point, s")
        figure.align_ylabels(axes)
        _trajectory_legend(figure, bool(len(window.quarantined_s)))
    return figure


def _trajectory_legend(figure: Figure, quarantined: bool) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=SIGNALS["logged"], label="sample"),
        Line2D([], [], color=SIGNALS["set_point"], linestyle="--", label="set-point"),
        Patch(facecolor=BANDS[0], edgecolor=RULE, linewidth=0.5, label="segment"),
    ]
    if quarantined:
        mark = Line2D([], [], color=QUARANTINE, linestyle="", marker="|", markersize=8, label="quarantined")
        handles.append(mark)
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))


DENSITY = LinearSegmentedColormap.from_list("density", ["#d6e4f0", "#7fb2d6", "#2a76b0", "#08306b", "#02122b"])

_AGAINST_ERROR = (
    ("voltage_deviation_v", "voltage deviation, V", 1.0),
    ("gap_velocity_m_s", "gap velocity, mm/s", 1e3),
    ("current_error_a", "current error, A", 1.0),
)


def coverage_figure(candidates: pd.DataFrame, curated: pd.DataFrame, bins: int = 48) -> Figure:
    """Where the transitions lie: voltage, velocity and current over the gap error, before balance and after it.

    All six histograms have one logarithmic colour scale. Rows beyond the 0.1 % quantiles are counted at the edge.
    """
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 5.2), layout="constrained")
        axes = figure.subplots(2, 3, sharex=True, sharey="col", squeeze=False)
        counts: list[tuple[Axes, Array, Array, Array]] = []
        x_edges = _edges(1e3 * candidates["gap_error_m"].to_numpy(), bins)
        for column, (name, label, scale) in enumerate(_AGAINST_ERROR):
            y_edges = _edges(scale * candidates[name].to_numpy(), bins)
            for row, table in enumerate((candidates, curated)):
                x = np.clip(1e3 * table["gap_error_m"].to_numpy(), x_edges[0], x_edges[-1])
                y = np.clip(scale * table[name].to_numpy(), y_edges[0], y_edges[-1])
                counts.append((axes[row, column], np.histogram2d(x, y, (x_edges, y_edges))[0].T, x_edges, y_edges))
                axes[row, column].set_ylabel(label)
        top = max(2.0, max(float(count.max()) for _, count, _, _ in counts))
        for ax, count, xs, ys in counts:
            ax.grid(False)
            filled = np.ma.masked_equal(count, 0)
            image = ax.pcolormesh(xs, ys, filled, norm=LogNorm(1, top), cmap=DENSITY, rasterized=True)
        for row, text in enumerate(("before balance", "after balance")):
            axes[row, 0].set_title(f"{text}: {len((candidates, curated)[row]):,} rows", fontsize=9)
        for ax in axes[1]:
            ax.set_xlabel("gap error, mm")
        bar = figure.colorbar(image, ax=axes, aspect=40, pad=0.015, label="rows in a cell of the histogram")
        log_ticks(bar.ax, "y")
        bar.outline.set_visible(False)
    return figure


def _edges(values: Array, bins: int) -> Array:
    low, high = np.quantile(values, [0.001, 0.999])
    if not high > low:
        low, high = low - 0.5, high + 0.5
    return np.linspace(low, high, bins + 1)


def prefill_figure(columns: Mapping[str, Mapping[str, NDArray[np.generic]]]) -> Figure:
    """Costs and actions of the prefilled rows; algorithms that start from the same rows share a line."""
    shared: dict[bytes, list[str]] = {}
    for name, part in columns.items():
        shared.setdefault(part["cost"].tobytes() + part["action"].tobytes(), []).append(name)
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 2.5), layout="constrained")
        left, right = figure.subplots(1, 2)
        costs = [np.asarray(columns[names[0]]["cost"], dtype=np.float64) for names in shared.values()]
        positive = np.concatenate([cost[cost > 0] for cost in costs])
        low, high = (positive.min(), positive.max()) if len(positive) else (0.1, 1.0)
        edges = np.geomspace(low, max(high, low * 1.01), 51)
        for names, cost, style in zip(shared.values(), costs, ("-", (0, (4, 2)), (0, (1, 1))), strict=False):
            label = " and ".join(algorithm_label(name) for name in names)
            _steps(left, np.clip(cost, edges[0], edges[-1]), edges, label, style)
            action = np.asarray(columns[names[0]]["action"], dtype=np.float64)
            _steps(right, action, np.linspace(-1, 1, 51), label, style)
        left.set_xscale("log")
        left.set_xlabel("cost of a row")
        log_ticks(left, "x")
        left.set_ylim(bottom=0)
        left.yaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
        right.set_yscale("log")
        right.set_ylim(bottom=0.7)
        log_ticks(right, "y")
        right.set_xlim(-1, 1)
        right.set_xlabel("action (voltage deviation over its limit)")
        for ax in (left, right):
            ax.set_ylabel("rows")
        if len(shared) > 1:
            left.legend(loc="upper left")
    return figure


def _steps(ax: Axes, values: Array, edges: Array, name: str, style: object) -> None:
    counts, _ = np.histogram(values, edges)
    ax.stairs(counts, edges, label=name, color=SOFT, linestyle=style, linewidth=1.2, gid=name)
