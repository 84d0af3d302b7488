"""From samples to a judged plant: rows, windows, fit, intervals, held-out pieces, verdicts."""

from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.errors import InputError
from maglev_offline.identify import checks
from maglev_offline.identify.equations import ELECTRICAL, MECHANICAL, STATIC, Problem, declared_values, scales
from maglev_offline.identify.findings import facts_of, median_r2, profiles, residual_table, warnings_of
from maglev_offline.identify.fit import Fit, Task, declared_start, fit, refit
from maglev_offline.identify.rows import FreeRows, free_rows
from maglev_offline.identify.settings import NAMES, IdentifySettings
from maglev_offline.identify.uncertainty import Uncertainty, uncertainty
from maglev_offline.identify.verdict import Parameter, judge, left_out, limited
from maglev_offline.identify.windows import BOXES, Windows, longest, windows
from maglev_offline.physics.parameters import Plant

STATIC_WIDTH = 8
"""Rows between the knots of a window where rows are too far apart for anything but averages."""

LITTLE = 0.5
"""An equation that explains less than this share of the held-out variance makes its parameters weak at best."""


@dataclass(frozen=True)
class Identified:
    """A judged plant. `parameters` in the order of `NAMES`; `facts` are JSON-able; `residuals` is a small table."""

    parameters: tuple[Parameter, ...]
    facts: dict[str, Any]
    counts: dict[str, int]
    left_out: dict[str, int]
    warnings: tuple[str, ...]
    residuals: pd.DataFrame


def phase_per_sample(plant: Plant, gap_m: float, period_s: float) -> float:
    """By how much the unstable plant turns from one sample to the next, in rad: sqrt(2 g / (x + a)) T."""
    return sqrt(2 * plant.gravity_m_s2 / (gap_m + plant.pole_offset_m)) * period_s


def identify(samples: pd.DataFrame, plant: Plant, settings: IdentifySettings, where: str = "samples") -> Identified:
    """Fit the plant to samples (columns of the samples table) of one or more logs and judge each parameter.

    Raises
    ------
    InputError: rows that cannot be fitted: none, too few, not finite, all in contact, still, or too short segments.
    """
    rows = free_rows(samples, where)
    gap = float(np.median(np.concatenate([s.gap_m for s in rows.stretches])))
    phase = phase_per_sample(plant, max(gap, plant.gap_min_m), rows.period_s)
    dynamic = phase <= settings.refuse_phase_rad
    names = tuple(n for n in NAMES if n in settings.parameters and (dynamic or n in STATIC))
    if not names:
        raise InputError(
            f"rows {rows.period_s * 1e3:g} ms apart let the plant turn by {phase:.1f} rad from row to row, more than "
            f"identify.refuse_phase_rad = {settings.refuse_phase_rad:g}: none of the parameters that were asked for "
            "shows in them.",
            where=where,
            todo="Record with a shorter period, or fit resistance_ohm and voltage_offset_v.",
        )
    cut = _windows(rows, phase, dynamic, len(names), settings, where)
    problem = Problem(cut, plant, dynamic)
    task = declared_start(problem, names, scales(problem), settings)
    fitted = fit(task)
    pieces = _pieces(rows, cut, settings)
    folds = [refit(task, fitted, pieces != k) for k in range(pieces.max() + 1)] if pieces.max() > 0 else []
    wider = _wider(rows, task, fitted, settings)
    sure = uncertainty(fitted, wider, cut, folds, settings.loss, settings.confidence)
    unseen = _unseen(problem, pieces, folds, rows)
    judged = _judged(problem, fitted, sure, unseen, phase, settings)
    facts = facts_of(problem, fitted, sure, judged, unseen, phase, rows)
    facts["profiles"] = profiles(task, fitted, judged)
    counts = {
        "rows": len(samples),
        "free_rows": rows.rows,
        "windows": len(cut),
        "stretches": len(rows.stretches),
        "stretches_used": len(np.unique(cut.stretch)),
        "blocks": sure.blocks,
    }
    used = set(cut.stretch.tolist())
    short = sum(len(s) for k, s in enumerate(rows.stretches) if k not in used)
    return Identified(
        judged,
        facts,
        counts,
        {**rows.left_out, "segment_shorter_than_window": short},
        warnings_of(phase, dynamic, rows, facts, settings),
        residual_table(problem, fitted, rows, settings),
    )


def _windows(
    rows: FreeRows, phase: float, dynamic: bool, parameters: int, settings: IdentifySettings, where: str
) -> Windows:
    width = max(1, round(settings.filter_time_constants / phase)) if dynamic else STATIC_WIDTH
    margin = int(np.ceil(settings.most_delay_samples))
    cut = windows(rows, width, margin, settings.most_windows)
    support = 2 * (BOXES * width // 2 + margin) + 1
    if len(cut) == 0:
        raise InputError(
            f"the longest of {len(rows.stretches)} stretches has {longest(rows.stretches)} rows, and one window needs "
            f"{support}.",
            where=where,
            todo="Use longer recordings, or a smaller identify.filter_time_constants.",
        )
    needed = settings.least_windows_per_parameter * parameters
    apart = sum(len(s) // cut.kernel.support for s in rows.stretches if len(s) >= support)
    if apart < needed:
        raise InputError(
            f"{rows.rows:,} free rows hold {apart} windows of {cut.kernel.support} rows end to end; {parameters} "
            f"parameters need {needed}, which is {needed * cut.kernel.support:,} rows without a gap.",
            where=where,
            todo="Use more recordings, or fit fewer identify.parameters.",
        )
    return cut


def _wider(rows: FreeRows, task: Task, fitted: Fit, settings: IdentifySettings) -> Fit | None:
    """The fit with windows half as wide again, or nothing where the stretches are too short for them."""
    first = task.problem.windows
    width = first.kernel.width + max(1, first.kernel.width // 2)
    cut = windows(rows, width, first.margin, settings.most_windows)
    if len(cut) < settings.least_windows_per_parameter * len(task.names):
        return None
    again = replace(task, problem=replace(task.problem, windows=cut), start=fitted.values)
    return fit(again, fitted.spread)


def _pieces(rows: FreeRows, cut: Windows, settings: IdentifySettings) -> NDArray[np.int64]:
    """Piece of each window [n]: its log where there are several (at most `folds` groups), else a stretch of time."""
    logs = [s.log_id for s in rows.stretches]
    used = list(dict.fromkeys(logs[k] for k in cut.stretch))
    if len(used) > 1:
        group = {log: k % settings.folds for k, log in enumerate(used)}
        return np.array([group[logs[k]] for k in cut.stretch], dtype=np.int64)
    return np.arange(len(cut), dtype=np.int64) * settings.folds // len(cut)


def _unseen(problem: Problem, pieces: NDArray[np.int64], folds: list[Fit], rows: FreeRows) -> list[dict[str, Any]]:
    """What each fold explains of the piece it did not see, with the logs of that piece."""
    found = []
    for k, fold in enumerate(folds):
        chosen = pieces == k
        logs = sorted({rows.stretches[s].log_id for s in problem.windows.stretch[chosen]})
        spread = {name: fold.spread[name] for name in fold.equations}
        estimates = {name: fold.values[name] for name in fold.names}
        result = checks.held_out(problem.take(chosen), fold.values, spread)
        found.append({"piece": k, "logs": logs, **result, "estimates_without_it": estimates})
    return found


def _judged(
    problem: Problem,
    fitted: Fit,
    sure: Uncertainty,
    unseen: list[dict[str, Any]],
    phase: float,
    settings: IdentifySettings,
) -> tuple[Parameter, ...]:
    declared = declared_values(problem.plant)
    voltage, current = median_r2(unseen, "voltage"), median_r2(unseen, "current")
    found = []
    for name in NAMES:
        if name not in fitted.names:
            asked = name in settings.parameters
            why = "rows too far apart" if asked else "not among identify.parameters"
            if asked:
                why = f"the plant turns by {phase:.1f} rad from row to row (at {pi:.2f} rad nothing is left of a swing)"
            found.append(left_out(name, declared[name], why, asked=asked))
            continue
        one = judge(name, declared[name], fitted, sure, settings)
        if problem.dynamic and phase > settings.warn_phase_rad:
            one = limited(one, f"the plant turns by {phase:.1f} rad from row to row")
        if name in ELECTRICAL and name != "pole_offset_m" and voltage is not None and voltage < LITTLE:
            one = limited(one, f"the electrical equation explains {voltage:.0%} of the unseen voltage")
        if name in MECHANICAL and current is not None and current < LITTLE:
            one = limited(one, f"the mechanical equation explains {current:.0%} of the unseen current")
        found.append(one)
    offset = found[NAMES.index("voltage_offset_v")]
    why = checks.not_ohmic(problem, fitted.values, offset.low, offset.high) if "electrical" in fitted.equations else ""
    if why and "resistance_ohm" in fitted.names:
        found[0] = limited(found[0], why)
    return tuple(found)
