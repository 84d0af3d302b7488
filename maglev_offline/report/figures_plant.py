"""Figures of the plant and its classical controllers: force, root locus, responses, and what each one survives."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from maglev_offline.physics.dynamics import suspension_force
from maglev_offline.physics.parameters import Plant
from maglev_offline.report.numbers import number, plain
from maglev_offline.report.style import FULL_WIDTH, INK, QUARANTINE, SOFT, controller_stroke, figure_style

CURRENT_SHARES = (0.5, 0.75, 1.0, 1.25, 1.5)
"""Currents of the lines of force, as shares of the one that carries the mass."""

FORCE_LEVELS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Lines of equal force, as multiples of the weight."""

WITHIN_M = 0.5e-3
"""A controller that survives and stays this close to the set-point has done its work."""

SURVIVAL_CLASSES = (("within 0.5 mm", "#00507d"), ("survives, farther off", "#8cc5ea"), ("touches a stop", "#d55e00"))
"""What becomes of a case, and its colour; they differ in lightness too. The index is the class."""

SAMPLING_LABELS = {"continuous": "continuous", "euler": "forward Euler", "zoh": "zero-order hold"}

MAPS = (("mass", "mass_kg", "mass, kg"), ("voltage_limit", "voltage_limit_v", "voltage limit, V"))
"""The two maps of robustness: name, column and label of what varies beside the start."""

_RANGE_LINES = {"euler": ("#D55E00", (0, (5, 2))), "zoh": ("#0072B2", (0, (2, 1.5)))}
_STABLE = "#009E73"
_GAINS = "viridis"
_MOST_STARTS = 5
_RING: dict[str, Any] = {"color": QUARANTINE, "markersize": 8, "markerfacecolor": "none", "markeredgewidth": 1.6}
_BOX: dict[str, Any] = {"boxstyle": "square,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}


def force_figure(plant: Plant) -> Figure:
    """The suspension force over gap and current: from above with lines of equal force, and over the gap."""
    weight_n = plant.mass_kg * plant.gravity_m_s2
    scale, unit = (1e-3, "kN") if weight_n >= 1e3 else (1.0, "N")
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 3.5), layout="constrained")
        above, over = figure.subplots(1, 2, width_ratios=(1.08, 1))
        _draw_surface(above, plant, weight_n, scale, unit)
        _draw_force_lines(over, plant, weight_n, scale, unit)
    return figure


def _draw_force_lines(ax: Axes, plant: Plant, weight_n: float, scale: float, unit: str) -> None:
    point = plant.equilibrium()
    gap = np.linspace(plant.gap_min_m, plant.gap_max_m, 400)
    colours = matplotlib.colormaps["YlGnBu"]
    for share in reversed(CURRENT_SHARES):
        current = share * point.current_a
        (line,) = ax.plot(1e3 * gap, scale * suspension_force(plant, gap, current), color=colours(share / 1.5))
        line.set(label=f"{number(current)} A", linewidth=2.0 if share == 1 else 1.3, gid=f"force-{share:g}")
    ax.axhline(scale * weight_n, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), gid="weight")
    ax.text(1.01, scale * weight_n, "m g", transform=ax.get_yaxis_transform(), va="center", fontweight="bold")
    ax.plot(1e3 * point.gap_m, scale * weight_n, "o", color=INK, markersize=6, gid="equilibrium")
    ax.set(xlim=(0, 1e3 * plant.gap_max_m), ylim=(0, 3.2 * scale * weight_n))
    ax.set(xlabel="gap, mm", ylabel=f"suspension force, {unit}")
    ax.set_title("over the gap", pad=20)
    ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    ax.legend(loc="upper right", title="current", alignment="left", frameon=True, framealpha=0.9, edgecolor="none")


def _draw_surface(ax: Axes, plant: Plant, weight_n: float, scale: float, unit: str) -> None:
    """Filled by the force; on a line of equal force the current is in proportion to gap + pole offset."""
    point = plant.equilibrium()
    gap = np.linspace(plant.gap_min_m, plant.gap_max_m, 161)
    current = np.linspace(0, 2.2 * point.current_a, 161)
    force = suspension_force(plant, gap[None, :], current[:, None])
    levels = [0.0, *(weight_n * level for level in FORCE_LEVELS)]
    norm = BoundaryNorm(levels, 256, extend="max")
    ax.contourf(1e3 * gap, current, force, levels, cmap="Blues", norm=norm, extend="max").set_rasterized(True)
    for level in FORCE_LEVELS:
        slope, bold = np.sqrt(level * plant.kappa), level == 1
        top = current[-1] / slope - plant.pole_offset_m
        right = top >= plant.gap_max_m
        ends = np.array([plant.gap_min_m, plant.gap_max_m if right else top])
        if ends[1] <= ends[0]:
            continue
        line = slope * (ends + plant.pole_offset_m)
        ax.plot(1e3 * ends, line, color=INK, linewidth=1.6 if bold else 0.6, gid=f"level-{level:g}")
        ax.annotate(
            number(scale * level * weight_n) + (f" {unit} = m g" if bold else f" {unit}"),
            (1e3 * ends[1], line[1]),
            xytext=(5, 0) if right else (0, 4),
            textcoords="offset points",
            ha="left" if right else "center",
            va="center" if right else "bottom",
            fontweight="bold" if bold else "normal",
        )
    ax.plot(1e3 * point.gap_m, point.current_a, "o", color=INK, markersize=6, gid="equilibrium")
    text = f"equilibrium: {plain(1e3 * point.gap_m)} mm, {number(point.current_a)} A"
    place = (1e3 * point.gap_m, point.current_a)
    ax.annotate(text, place, textcoords="offset points", xytext=(5, -8), va="top", bbox=_BOX)
    ax.set(xlim=(1e3 * plant.gap_min_m, 1e3 * plant.gap_max_m), ylim=(0, current[-1]))
    ax.set(xlabel="gap, mm", ylabel="current, A")
    ax.set_title("over gap and current, with lines of equal force", pad=20)
    ax.grid(False)


def root_locus_figure(locus: pd.DataFrame, ranges: Sequence[Mapping[str, Any]], kp: float) -> Figure:
    """Poles of the PID's loop over Kp in the complex plane, and beside them the largest real part over Kp.

    `locus`: columns kp, real_rad_s, imag_rad_s, a row for each pole. `ranges`: the stable ones of Kp, each with
    sampling, step_s, lowest, highest. `kp`: the recipe's.
    """
    marked = _at(locus, kp) if len(_at(locus, kp)) else locus
    near = 2.5 * float(np.hypot(marked["real_rad_s"], marked["imag_rad_s"]).min())
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 3.5), layout="constrained")
        plane, origin, largest = figure.subplots(1, 3, width_ratios=(1, 0.85, 1.15))
        _draw_plane(plane, locus, kp)
        plane.set_title("closed-loop poles")
        drawn = _draw_plane(origin, locus, kp)
        origin.set(title="those near the origin", ylabel="")
        if near > 0:
            origin.set(xlim=(-near, near), ylim=(-near, near))
        bar = figure.colorbar(drawn, ax=[plane, origin], pad=0.02, aspect=32, label="Kp, V/m")
        if bar.solids is not None:
            bar.solids.set(rasterized=True, edgecolor="face")
        _draw_largest(largest, locus, ranges, kp)
        handles = [*plane.get_legend_handles_labels()[0], *largest.get_legend_handles_labels()[0]]
        figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), columnspacing=1.4)
    return figure


def _draw_plane(ax: Axes, locus: pd.DataFrame, kp: float) -> PathCollection:
    real, imag = locus["real_rad_s"], locus["imag_rad_s"]
    low, high = min(float(real.min()), 0.0), max(float(real.max()), 0.0)
    margin = 0.07 * max(high - low, 1e-9)
    ax.set_xlim(low - margin, high + margin)
    ax.axvspan(0, 100 * (high + margin), color="#faece4", linewidth=0, zorder=0)
    ax.axvline(0, color=INK, linewidth=1.4, zorder=1.8, gid="imaginary-axis")
    drawn = ax.scatter(real, imag, c=locus["kp"], cmap=_GAINS, s=7, linewidths=0, zorder=2, rasterized=True)
    marked = _at(locus, kp)
    if len(marked):
        ring = {**_RING, "gid": "recipe", "zorder": 3, "label": f"Kp = {kp:,.6g} V/m"}
        ax.plot(marked["real_rad_s"], marked["imag_rad_s"], "o", **ring)
    ax.set(xlabel="real part, 1/s", ylabel="imaginary part, rad/s")
    return drawn


def _at(locus: pd.DataFrame, kp: float) -> pd.DataFrame:
    """The poles at the gain next to `kp`; none where the locus does not reach it."""
    gains = locus["kp"].to_numpy()
    inside = gains.min() <= kp <= gains.max()
    return locus.iloc[np.flatnonzero(inside & (gains == gains[np.argmin(np.abs(gains - kp))]))]


def _draw_largest(ax: Axes, locus: pd.DataFrame, ranges: Sequence[Mapping[str, Any]], kp: float) -> None:
    rows = locus.groupby("kp")["real_rad_s"].max()
    ax.axhline(0, color=INK, linewidth=1.4, zorder=1.8)
    for found in ranges:
        sampling, limits = str(found["sampling"]), (float(found["lowest"]), float(found["highest"]))
        name = SAMPLING_LABELS.get(sampling, sampling)
        if found["step_s"] is not None:
            name += f", {plain(1e3 * found['step_s'])} ms"
        if sampling == "continuous":
            ax.axvspan(*limits, color=_STABLE, alpha=0.16, linewidth=0, zorder=0, label=f"stable, {name}", gid="stable")
            continue
        colour, dash = _RANGE_LINES.get(sampling, (SOFT, (0, (1, 1))))
        for place, limit in enumerate(limits):
            label = "" if place else f"stable, {name}"
            ax.axvline(limit, color=colour, linestyle=dash, linewidth=1.2, label=label, gid=f"{sampling}-{place}")
    ax.plot(rows.index, rows, color=INK, linewidth=1.8, gid="largest")
    if len(_at(locus, kp)):
        ax.plot(kp, _at(locus, kp)["real_rad_s"].max(), "o", gid="recipe", **_RING)
    ax.set_xlim(float(rows.index.min()), float(rows.index.max()))
    ax.set(xlabel="Kp, V/m", ylabel="largest real part, 1/s", title="stable below 0")


def robustness_classes(table: pd.DataFrame) -> NDArray[np.int64]:
    """The class of each row, an index of `SURVIVAL_CLASSES`; an error that is no number is none within 0.5 mm."""
    survives, near = table["survives"].to_numpy(dtype=bool), table["worst_error_m"].to_numpy() <= WITHIN_M
    return np.where(survives & near, 0, np.where(survives, 1, 2))


def robustness_figure(table: pd.DataFrame, plant: Plant | None = None, voltage_limit_v: float | None = None) -> Figure:
    """What each controller survives: start against mass above, start against voltage limit below.

    `table`: controller, map, start_gap_m, mass_kg, voltage_limit_v, survives, worst_error_m. The set-point and the
    nominal mass of `plant`, and the recipe's `voltage_limit_v`, are marked where they are given.
    """
    table = table.assign(verdict=robustness_classes(table))
    controllers = list(dict.fromkeys(table["controller"]))
    nominal = {"mass": plant.mass_kg if plant else None, "voltage_limit": voltage_limit_v}
    colours = ListedColormap([colour for _, colour in SURVIVAL_CLASSES])
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 4.4), layout="constrained")
        axes = figure.subplots(len(MAPS), len(controllers), sharex=True, sharey="row", squeeze=False)
        for row, (name, column, label) in enumerate(MAPS):
            for place, controller in enumerate(controllers):
                ax = axes[row, place]
                cases = table[(table["map"] == name) & (table["controller"] == controller)]
                if len(cases):
                    cells = cases.pivot(index=column, columns="start_gap_m", values="verdict")
                    x, y = 1e3 * cells.columns.to_numpy(dtype=float), cells.index.to_numpy(dtype=float)
                    norm = Normalize(-0.5, len(SURVIVAL_CLASSES) - 0.5)
                    mesh = ax.pcolormesh(x, y, cells, cmap=colours, norm=norm, shading="nearest", rasterized=True)
                    mesh.set_gid(f"{name}-{controller}")
                _mark(ax, None if plant is None else 1e3 * plant.set_point_m, nominal[name])
                ax.grid(False)
                if row == 0:
                    ax.set_title(controller_stroke(controller).label)
                if row == len(MAPS) - 1:
                    ax.set_xlabel("start gap, mm")
                if place == 0:
                    ax.set_ylabel(label)
        axes[0, 0].xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        handles: list[Patch | Line2D] = [Patch(color=colour, label=label) for label, colour in SURVIVAL_CLASSES]
        if plant is not None:
            handles.append(Line2D([], [], color=INK, linewidth=1, linestyle=(0, (3, 2)), label="nominal, set-point"))
        figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), columnspacing=1.6)
    return figure


def _mark(ax: Axes, x: float | None, y: float | None) -> None:
    """A cross of dashed lines, dark with a light rim so that it shows on every class."""
    for value, draw, gid in ((x, ax.axvline, "set-point"), (y, ax.axhline, "nominal")):
        if value is not None:
            draw(value, color="white", linewidth=1.5, alpha=0.6)
            draw(value, color=INK, linewidth=0.8, linestyle=(0, (3, 2)), gid=gid)


def step_responses_figure(responses: pd.DataFrame, set_point_m: float | None = None, duration_s: float = 0.5) -> Figure:
    """Gap over the first `duration_s` from several starts, for each controller: linear beside nonlinear plant.

    All panels share the range of the nonlinear plant and its starts; a panel says how far its lines leave it.
    `responses`: columns controller, plant_kind, start_gap_m, t_s, gap_m.
    """
    rows = responses[responses["t_s"] <= duration_s]
    rows = rows[rows["start_gap_m"].isin(_some(np.sort(rows["start_gap_m"].unique())))]
    controllers = list(dict.fromkeys(rows["controller"]))
    kinds = [kind for kind in ("linear", "nonlinear") if kind in set(rows["plant_kind"])]
    kept = rows.loc[rows["plant_kind"] == "nonlinear", "gap_m"] if "nonlinear" in kinds else rows["start_gap_m"]
    low, high = 1e3 * float(kept.min()), 1e3 * float(kept.max())
    room = 0.08 * max(high - low, 1e-3)
    lines = -(-len(controllers) // 2)
    with figure_style():
        figure = Figure(figsize=(FULL_WIDTH, 0.5 + 1.6 * lines), layout="constrained")
        axes = figure.subplots(lines, 2 * len(kinds), sharex=True, sharey=True, squeeze=False)
        for ax in axes.flat[len(controllers) * len(kinds) :]:
            ax.set_visible(False)
        panels = [(name, kind) for name in controllers for kind in kinds]
        for ax, (name, kind) in zip(axes.flat, panels, strict=False):
            _draw_steps(ax, rows[(rows["controller"] == name) & (rows["plant_kind"] == kind)], name)
            ax.set_title(f"{controller_stroke(name).label}, {kind}")
            _note_leaving(ax, low - room, high + room)
            if set_point_m is not None:
                ax.axhline(1e3 * set_point_m, color=SOFT, linewidth=0.7, linestyle=":", zorder=1)
        axes[0, 0].set(xlim=(0, duration_s), ylim=(low - room, high + room))
        for ax in axes[:, 0]:
            ax.set_ylabel("gap, mm")
        for ax in axes.flat[max(0, len(panels) - axes.shape[1]) : len(panels)]:
            ax.set_xlabel("time, s")
            ax.tick_params(labelbottom=True)
    return figure


def _some(starts: NDArray[Any]) -> NDArray[Any]:
    """At most five of the starts, the outer ones among them, so that single lines can be told apart."""
    places = np.linspace(0, len(starts) - 1, min(len(starts), _MOST_STARTS)).round().astype(int)
    return np.asarray(starts[places])


def _draw_steps(ax: Axes, rows: pd.DataFrame, name: str) -> None:
    for start, one in rows.groupby("start_gap_m"):
        (line,) = ax.plot(one["t_s"], 1e3 * one["gap_m"], color=controller_stroke(name).colour, linewidth=1.1)
        line.set_gid(f"start-{start:g}")


def _note_leaving(ax: Axes, low: float, high: float) -> None:
    values = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in ax.get_lines()] or [np.empty(0)])
    values = values[np.isfinite(values)]
    style: dict[str, Any] = {"transform": ax.transAxes, "ha": "right", "fontsize": 8, "bbox": _BOX}
    top, bottom = values.max(initial=low), values.min(initial=high)
    if top > high:
        ax.text(0.98, 0.96, f"↑ to {number(top)} mm", va="top", **style)
    if bottom < low:
        ax.text(0.98, 0.04, f"↓ to {number(bottom)} mm", va="bottom", **style)
