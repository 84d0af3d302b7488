"""What an identification has to tell beside the verdicts: facts, profiles, warnings, a table of residuals."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.identify import checks
from maglev_offline.identify.equations import Problem
from maglev_offline.identify.fit import Fit, Task, fit, mean_cost
from maglev_offline.identify.rows import FreeRows
from maglev_offline.identify.settings import IdentifySettings
from maglev_offline.identify.uncertainty import Uncertainty
from maglev_offline.identify.verdict import IDENTIFIED, Parameter

PROFILED = 800
"""Windows that a profile is computed on."""


def median_r2(unseen: list[dict[str, Any]], what: str) -> float | None:
    """Median over the pieces of the R^2 of `voltage`, `acceleration` or `current`."""
    found = [piece[what]["r2"] for piece in unseen if what in piece and piece[what]["r2"] is not None]
    return float(np.median(found)) if found else None


def facts_of(
    problem: Problem,
    fitted: Fit,
    sure: Uncertainty,
    judged: tuple[Parameter, ...],
    unseen: list[dict[str, Any]],
    phase: float,
    rows: FreeRows,
) -> dict[str, Any]:
    """What the manifest holds beside the verdicts."""
    step = -(-problem.windows.kernel.support // problem.windows.stride)
    parts = dict(zip(fitted.equations, np.split(fitted.residual, len(fitted.equations)), strict=True))
    facts: dict[str, Any] = {
        "period_s": rows.period_s,
        "window_s": problem.windows.kernel.support * rows.period_s,
        "phase_per_sample_rad": phase,
        "condition_number": sure.condition if np.isfinite(sure.condition) else None,
        "correlation": {
            "names": list(fitted.names),
            "matrix": [[round(float(value), 6) for value in row] for row in sure.correlation],
        },
        "block_s": sure.block_rows * rows.period_s,
        "residual_spread": {name: fitted.spread[name] for name in fitted.equations},
        "whiteness": {name: checks.ljung_box(part, problem.windows.stretch, step) for name, part in parts.items()},
        "held_out": unseen,
        "held_out_median_r2": {what: median_r2(unseen, what) for what in ("voltage", "acceleration", "current")},
    }
    if "electrical" in fitted.equations:
        facts["voltage_check"] = checks.voltage_check(problem, fitted.values)
    if "mechanical" in fitted.equations:
        facts["balance_check"] = checks.balance_check(problem, fitted.values)
    known = {p.name: p.estimate for p in judged if p.verdict == IDENTIFIED}
    slope, gain = known.get("inductance_slope_h_m"), known.get("gain_h_m_per_kg")
    # Two ways to the same c: were the mass known, it would be a test of the model.
    facts["mass_implied_kg"] = slope / gain if slope and gain else None
    return facts


def profiles(task: Task, fitted: Fit, judged: tuple[Parameter, ...]) -> dict[str, Any]:
    """Rise of the cost along each badly known parameter, all others fitted anew: a flat one rises by nothing.

    The mean robust loss in squared standard deviations, at 7 values within half a scale of the estimate, on at most
    `PROFILED` windows.
    """
    loss, n = task.settings.loss, len(task.problem.windows)
    thin = replace(task, problem=task.problem.take(np.arange(n) % -(-n // PROFILED) == 0), start=fitted.values)
    base = mean_cost(fit(thin, fitted.spread).residual, loss)
    lowest = -0.9 * max(float(task.problem.windows.gap.min()), 0.0)
    found: dict[str, Any] = {}
    for one in judged:
        others = tuple(name for name in fitted.names if name != one.name)
        if one.estimate is None or one.verdict == IDENTIFIED or not others:
            continue
        values = one.estimate + np.linspace(-0.5, 0.5, 7) * fitted.scale[one.name]
        if one.name == "pole_offset_m":
            values = values[values >= lowest]
        starts = [{**fitted.values, one.name: float(value)} for value in values]
        again = [fit(replace(thin, names=others, start=start), fitted.spread) for start in starts]
        found[one.name] = {"values": values.tolist(), "rise": [mean_cost(f.residual, loss) - base for f in again]}
    return found


def warnings_of(
    phase: float, dynamic: bool, rows: FreeRows, facts: dict[str, Any], settings: IdentifySettings
) -> tuple[str, ...]:
    """What a person should look at."""
    found = []
    period = f"rows {rows.period_s * 1e3:g} ms apart: the unstable plant turns by {phase:.2f} rad from row to row"
    if not dynamic:
        found.append(
            f"{period}, above identify.refuse_phase_rad = {settings.refuse_phase_rad:g}. Force, inductance and delay "
            "cannot be identified from them; averages give resistance and offset only."
        )
    elif phase > settings.warn_phase_rad:
        found.append(f"{period}, above identify.warn_phase_rad = {settings.warn_phase_rad:g}. Take it as a hint only.")
    if "voltage_check" in facts and not facts["voltage_check"]["holds"]:
        found.append(facts["voltage_check"]["text"])
    for name, test in facts["whiteness"].items():
        if test["p_value"] is not None and test["p_value"] < 0.01:
            found.append(
                f"the {name} residuals are not white (Ljung-Box p = {test['p_value']:.1g}, correlation "
                f"{test['lag_1']:+.2f} from window to window): the model leaves structure unexplained."
            )
    return tuple(found)


def residual_table(problem: Problem, fitted: Fit, rows: FreeRows, settings: IdentifySettings) -> pd.DataFrame:
    """Thinned residuals: log, point, segment, step of the window's middle, what was seen and what is left, SI."""
    at = np.unique(np.linspace(0, len(problem.windows) - 1, settings.stored_residuals).round().astype(np.int64))
    chosen = np.zeros(len(problem.windows), dtype=bool)
    chosen[at] = True
    part = problem.take(chosen)
    w = part.windows
    source = [rows.stretches[k] for k in w.stretch]
    table = pd.DataFrame(
        {
            "log_id": [s.log_id for s in source],
            "point": [s.point for s in source],
            "segment": np.array([s.segment for s in source], dtype=np.int32),
            "step": np.array([s.first_step for s in source], dtype=np.int32) + w.middle.astype(np.int32),
            "gap_m": w.mean_gap,
            "current_a": w.mean_current,
            "voltage_v": w.mean_voltage(fitted.values["delay_samples"]),
            "acceleration_m_s2": w.acceleration,
            "voltage_residual_v": np.nan,
            "acceleration_residual_m_s2": np.nan,
        }
    )
    if "electrical" in fitted.equations:
        table["voltage_residual_v"] = part.electrical(fitted.values)
    if "mechanical" in fitted.equations:
        table["acceleration_residual_m_s2"] = part.mechanical(fitted.values)
    return table
