"""Figures of what rows teach and of what the simulator explains: maps over the state space, and both advantages."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from maglev_offline.curate.diagnostic import FIT_ERROR, HARMFUL_ERROR
from maglev_offline.curate.diagnostic_cells import TOO_FEW
from maglev_offline.curate.residual_facts import sizes
from maglev_offline.curate.residual_map import MOST_NOT_EXPLAINED
from maglev_offline.report.figures_data import DENSITY
from maglev_offline.report.numbers import number, power_of_ten
from maglev_offline.report.style import FULL_WIDTH, INK, RULE, SOFT, VERDICTS, figure_style, log_ticks
from maglev_offline.report.typesetting import printable

Array = NDArray[np.float64]

_BLUES, _GREYS, _ORANGES = ("#2b7bb9", "#9ecae1"), ("#f3efe6", "#e3dac4"), ("#fdbe85", "#f1893f", "#c9501c", "#8c2d04")
"""Good, open and bad: told apart by lightness too, and by every common colour vision deficiency."""

_COLOURS = [*_BLUES, *_GREYS, *_ORANGES]
_DARK = {_BLUES[0], *_ORANGES[2:]}
"""Colours on which text is white."""

ERROR_STEPS = (0.25, FIT_ERROR, 1.5, HARMFUL_ERROR, 6.0, 12.0, 24.0)
SHARE_STEPS = (0.1, MOST_NOT_EXPLAINED, 0.7, 1.0, 3.0, 10.0, 30.0)
"""Where the colours of a map change: two blues below the first threshold, four oranges above the second."""

MOST_BARS = 8


def truth_figure(cells: pd.DataFrame, rows: pd.DataFrame) -> Figure:
    """The diagnostic by cell beside the taught advantage over the true one, each row for as many as it stands for."""
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 4.5), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.12, 1))
        _map(figure, left, cells, cells["error_over_advantage_std"], ERROR_STEPS, "error over spread of advantage")
        left.set_title("error of the targets, by cell")
        _advantages(figure, right, rows)
    return figure


def residual_figure(table: pd.DataFrame, names: Mapping[str, str]) -> Figure:
    """The residual by region beside that by log; `table`: the rows of one length, `names`: what logs are called."""
    regions, logs = (table[table["kind"] == kind].reset_index(drop=True) for kind in ("region", "log"))
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 4.5), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.12, 1))
        _map(figure, left, regions, regions["unexplained_share"], SHARE_STEPS, "share not explained")
        left.set_title("share not explained, by region")
        _bars(right, logs, [names.get(log, log) for log in logs["log_id"]])
    return figure


def _map(figure: Figure, ax: Axes, cells: pd.DataFrame, values: pd.Series, steps: Sequence[float], label: str) -> None:
    """Cells of equal size, coloured by `values`, with their count of rows; grey and hatched where there are too few."""
    colours = ListedColormap(_COLOURS)
    norm = BoundaryNorm([-np.inf, *steps, np.inf], colours.N)
    across, up = cells["gap_cell"].to_numpy(), cells["velocity_cell"].to_numpy()
    for x, y, rows, value, verdict in zip(across, up, cells["rows"], values, cells["verdict"], strict=True):
        known = verdict != TOO_FEW and np.isfinite(value)
        colour = colours(int(norm(value))) if known else "#f6f7f9"
        edge, width = ("white", 0.8) if known else (RULE, 0.0)
        hatch = None if known else "////"
        ax.add_patch(Rectangle((x, y), 1, 1, facecolor=colour, edgecolor=edge, linewidth=width, hatch=hatch))
        if known:
            dark = _COLOURS[int(norm(value))] in _DARK
            ax.text(
                x + 0.5, y + 0.5, f"{rows:,}", ha="center", va="center", fontsize=7.5, color="white" if dark else INK
            )
    _cell_axis(ax, "x", cells, "gap", "gap error, mm")
    _cell_axis(ax, "y", cells, "velocity", "gap velocity, mm/s")
    ax.grid(False)
    # The outermost colours have no end; the bar gives each colour the same length.
    shown = BoundaryNorm(range(colours.N + 1), colours.N)
    bar = figure.colorbar(ScalarMappable(shown, colours), ax=ax, label=label, aspect=30, pad=0.02)
    bar.set_ticks(range(1, colours.N), labels=[f"{step:g}" for step in steps])
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0)
    for place in (2, 4):
        bar.ax.axhline(place, color=INK, linewidth=1.4)


def _cell_axis(ax: Axes, axis: str, cells: pd.DataFrame, name: str, label: str) -> None:
    """Write at each border between two cells where it lies."""
    unit = "m" if name == "gap" else "m_s"
    ends = cells.groupby(f"{name}_cell")[f"{name}_to_{unit}"].first()
    count = 1 + int(cells[f"{name}_cell"].max())
    ends = ends[np.isfinite(ends)]
    part = ax.xaxis if axis == "x" else ax.yaxis
    part.set_ticks(ends.index.to_numpy() + 1, labels=[number(1e3 * value, 2) for value in ends])
    part.set_label_text(label)
    (ax.set_xlim if axis == "x" else ax.set_ylim)(0, count)


def _advantages(figure: Figure, ax: Axes, rows: pd.DataFrame) -> None:
    """A histogram over both advantages, on axes that are linear about zero and logarithmic far away.

    Each row counts as many as it stands for.
    """
    true, taught, weight = (rows[name].to_numpy() for name in ("advantage", "taught_advantage", "weight"))
    width = float(np.quantile(np.abs(true), 0.5)) or 1.0
    far = max(float(np.quantile(np.abs(np.concatenate([true, taught])), 0.999)), 10 * width)
    edges = width * np.sinh(np.linspace(-1, 1, 50) * np.arcsinh(far / width))
    counts = np.histogram2d(np.clip(true, -far, far), np.clip(taught, -far, far), (edges, edges), weights=weight)[0].T
    for scale in (ax.set_xscale, ax.set_yscale):
        scale("asinh", linear_width=width)
    shown = np.ma.masked_equal(counts, 0)
    norm = LogNorm(1, max(2.0, float(counts.max())))
    image = ax.pcolormesh(edges, edges, shown, norm=norm, cmap=DENSITY, rasterized=True, gid="advantages")
    ax.plot([-far, far], [-far, far], color=VERDICTS["negative"], linewidth=1.0, gid="truth")
    ticks = _signed_decades(width, far)
    ax.set_xticks(ticks, labels=[_decade(value) for value in ticks])
    ax.set_yticks(ticks, labels=[_decade(value) for value in ticks])
    ax.minorticks_off()
    ax.set_xlim(-far, far)
    ax.set_ylim(-far, far)
    ax.set_xlabel("true advantage, cost")
    ax.set_ylabel("taught advantage, cost")
    ax.set_title("what the rows teach")
    bar = figure.colorbar(image, ax=ax, aspect=30, pad=0.02, label="rows")
    log_ticks(bar.ax, "y")
    bar.outline.set_visible(False)


def _signed_decades(width: float, far: float) -> list[float]:
    """Zero, and powers of ten to both sides from about `width` to `far`, at most three a side."""
    powers = list(range(int(np.ceil(np.log10(width))), int(np.floor(np.log10(far))) + 1))
    powers = powers[:: -max(1, -(-len(powers) // 3))]
    above = sorted(10.0**power for power in powers)
    return [*(-value for value in reversed(above)), 0.0, *above]


def _decade(value: float) -> str:
    if value == 0 or 1e-3 <= abs(value) < 1e4:
        return number(value, 1)
    return f"{'−' if value < 0 else ''}{power_of_ten(round(np.log10(abs(value))))}"


def _bars(ax: Axes, logs: pd.DataFrame, names: Sequence[str]) -> None:
    """For each log the rms of the residual, its offset within, and the rms of the change that was logged.

    Of more than `MOST_BARS` logs those with the largest residual.
    """
    norm = sizes(logs)
    most = np.sort(np.argsort(-norm["rms"].to_numpy(), kind="stable")[:MOST_BARS])
    norm, names = norm.iloc[most], [names[k] for k in most]
    place = np.arange(len(norm))[::-1]
    ax.barh(place, norm["rms"], height=0.6, color="#f6d0b0", gid="rms")
    ax.barh(place, norm["mean"], height=0.6, color=VERDICTS["negative"], gid="mean")
    ax.plot(norm["change"], place, linestyle="", marker="|", markersize=16, markeredgewidth=2, color=INK, gid="change")
    for y, name in zip(place, names, strict=True):
        ax.text(0, y + 0.34, printable(name), fontsize=8, color=SOFT, va="bottom", ha="left", parse_math=False)
    ax.set_yticks([])
    ax.set_ylim(-0.6, len(norm) - 0.2)
    ax.set_xlim(left=0)
    ax.grid(False, axis="y")
    ax.set_axisbelow(True)
    ax.set_xlabel("size, in state scales")
    ax.set_title("residual, by log")
    mark: list[Any] = [
        Patch(color=VERDICTS["negative"], label="offset"),
        Patch(color="#f6d0b0", label="with scatter"),
        *ax.plot([], [], linestyle="", marker="|", markersize=9, markeredgewidth=2, color=INK, label="logged change"),
    ]
    ax.legend(handles=mark, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, columnspacing=1.2)
