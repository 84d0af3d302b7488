"""What the residuals say: are they white, what is explained of pieces that no fit saw, and declared against seen."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from maglev_offline.identify.equations import Problem, Values, declared_values

Array = NDArray[np.float64]

LAGS = 10
NOT_OHMIC = 0.2
"""A voltage that goes as a power of the current this far from 1 is none of a resistance."""

OUTSIDE = 5.0
"""Windows whose residual is this many robust standard deviations away are told as a share, and not averaged in."""


def ljung_box(residual: Array, stretch: NDArray[np.int64], step: int) -> dict[str, Any]:
    """Test of Ljung and Box (1978) on every `step`-th window, so that no two overlap; nothing across stretches.

    Returns the statistic, lags, windows and the probability of the statistic if the residuals were white.
    """
    kept, of = residual[::step], stretch[::step]
    centred = kept - kept.mean()
    n, power = len(centred), float(centred @ centred)
    lags = min(LAGS, n // 5)
    if lags < 1 or power == 0:
        return {"statistic": None, "lags": 0, "windows": n, "p_value": None, "lag_1": None}
    rho = [float(np.sum((centred[k:] * centred[:-k])[of[k:] == of[:-k]])) / power for k in range(1, lags + 1)]
    statistic = n * (n + 2) * sum(r * r / (n - k) for k, r in enumerate(rho, 1))
    return {
        "statistic": statistic,
        "lags": lags,
        "windows": n,
        "p_value": float(chi2.sf(statistic, lags)),
        "lag_1": rho[0],
    }


def predicted_current(problem: Problem, p: Values) -> Array:
    """Current in A that would give the acceleration seen, by the mechanical equation, shape [n]."""
    w = problem.windows
    needed = (problem.plant.gravity_m_s2 - w.acceleration).clip(0)
    found: Array = w.mean_current * np.sqrt(needed / problem.pull(p).clip(1e-12))
    return found


def explained(seen: Array, left: Array, spread: float) -> dict[str, float | None]:
    """R^2 of `seen` with the residual `left`, over the windows within `OUTSIDE` spreads, and the share outside."""
    inside = np.abs(left) <= OUTSIDE * spread
    share = 1 - float(inside.mean())
    if inside.sum() < 3:
        return {"r2": None, "share_outside": share}
    total = float(np.sum((seen[inside] - seen[inside].mean()) ** 2))
    return {"r2": 1 - float(np.sum(left[inside] ** 2)) / total if total > 0 else None, "share_outside": share}


def held_out(problem: Problem, p: Values, spread: dict[str, float]) -> dict[str, Any]:
    """What a fit explains of windows that it did not see: voltage, acceleration, and current at the balance."""
    w = problem.windows
    found: dict[str, Any] = {"windows": len(w)}
    if "electrical" in spread:
        found["voltage"] = explained(w.mean_voltage(p["delay_samples"]), problem.electrical(p), spread["electrical"])
    if "mechanical" in spread:
        left = problem.mechanical(p)
        found["acceleration"] = explained(w.acceleration, left, spread["mechanical"])
        inside = np.abs(left) <= OUTSIDE * spread["mechanical"]
        off = (w.mean_current - predicted_current(problem, p))[inside]
        found["current"] = explained(w.mean_current[inside], off, float("inf"))
    return found


def voltage_check(problem: Problem, fitted: Values) -> dict[str, Any]:
    """Does the declared resistance explain the voltage? Medians of the windows nearest to the set-point, in numbers.

    `through_origin_ohm` is the resistance that the same windows would need without an offset.
    """
    w, plant = problem.windows, problem.plant
    off = np.abs(w.mean_gap - plant.set_point_m)
    near = off <= np.quantile(off, 0.25)
    gap, current = float(np.median(w.mean_gap[near])), float(np.median(w.mean_current[near]))
    voltage = float(np.median(w.mean_voltage(fitted["delay_samples"])[near]))
    declared = declared_values(plant)["resistance_ohm"]
    explained_v, observed = declared * current, voltage / current
    fitted_ohm, offset = fitted["resistance_ohm"], fitted["voltage_offset_v"]
    factor = observed / declared
    exponent = voltage_exponent(w.mean_current, static_voltage(problem, fitted))
    holds = 0.8 <= factor <= 1.25
    text = (
        f"At a gap of {gap * 1e3:.2f} mm and {current:.3g} A the voltage is {voltage:.3g} V; the declared "
        f"{declared:.3g} ohm explain {explained_v:.3g} V of it"
        + (": the declared resistance holds." if holds else f", but {factor:.2g} times that is seen. ")
        + (
            ""
            if holds
            else f"The samples ask for {fitted_ohm:.3g} ohm and an offset of {offset:+.2g} V "
            f"(without an offset {observed:.3g} ohm). The declared resistance does not fit these recordings."
        )
    )
    if not holds and exponent is not None:
        text += f" Over all rows the voltage goes as the current to the power of {exponent:.2f}"
        text += ", where a resistance has 1." if abs(exponent - 1) > 0.1 else ", as that of a resistance."
    return {
        "holds": holds,
        "voltage_exponent": exponent,
        "gap_m": gap,
        "current_a": current,
        "voltage_v": voltage,
        "declared_ohm": declared,
        "declared_explains_v": explained_v,
        "through_origin_ohm": observed,
        "fitted_ohm": fitted_ohm,
        "fitted_offset_v": offset,
        "text": text,
    }


def static_voltage(problem: Problem, p: Values) -> Array:
    """The voltage without the part that the fit ascribes to a changing flux, in V, shape [n]."""
    found: Array = problem.electrical(p) + p["resistance_ohm"] * problem.windows.mean_current + p["voltage_offset_v"]
    return found


def not_ohmic(problem: Problem, p: Values, offset_low: float | None, offset_high: float | None) -> str:
    """Why the voltage is not R i, in words, or nothing: a sure offset above a tenth of the voltage, or a bent curve."""
    voltage = static_voltage(problem, p)
    typical, offset = float(np.median(np.abs(voltage))), p["voltage_offset_v"]
    if (
        offset_low is not None
        and offset_high is not None
        and offset_low * offset_high > 0
        and abs(offset) > typical / 10
    ):
        return f"the voltage needs an offset of {offset:+.2g} V beside it, and the plant has none"
    exponent = voltage_exponent(problem.windows.mean_current, voltage)
    if exponent is not None and abs(exponent - 1) > NOT_OHMIC:
        return f"the voltage goes as the current to the power of {exponent:.2f}, and not of 1"
    return ""


def voltage_exponent(current: Array, voltage: Array) -> float | None:
    """Slope of log u over log i through the medians of ten equal ranges of the current: 1 for a resistance.

    None where the current varies by less than a half. Ranges of few rows count as the others do, so that what happens
    far from the set-point is seen.
    """
    low, high = np.quantile(current, [0.001, 0.999])
    low = max(float(low), 0.1 * float(high))
    if high <= 1.5 * low:
        return None
    number = np.floor((current - low) / (high - low) * 10)
    chosen = [(number == k) & (voltage > 0) for k in range(10)]
    medians = np.array([[np.median(current[c]), np.median(voltage[c])] for c in chosen if c.sum() >= 5])
    if len(medians) < 3:
        return None
    return float(np.polyfit(np.log(medians[:, 0]), np.log(medians[:, 1]), 1)[0])


def balance_check(problem: Problem, fitted: Values) -> dict[str, Any]:
    """Does the current that carries the mass agree with i(x) = sqrt(2 m g / c) (x + a)? Slope and level in numbers.

    The rows nearest to rest (the quarter with the smallest acceleration) are grouped by gap into ten bins.
    """
    w, plant = problem.windows, problem.plant
    still = np.abs(w.acceleration) <= np.quantile(np.abs(w.acceleration), 0.25)
    gap, current = w.mean_gap[still], w.mean_current[still]

    def law(p: Values) -> Array:
        found: Array = np.sqrt(2 * plant.gravity_m_s2 / p["gain_h_m_per_kg"]) * (gap + p["pole_offset_m"])
        return found

    declared, ours = law(declared_values(plant)), law(fitted)
    edges = np.quantile(gap, [0.05, 0.95])
    off_declared = float(np.median(np.abs(declared / current - 1)))
    off_fitted = float(np.median(np.abs(ours / current - 1)))
    return {
        "gaps_m": [float(edge) for edge in edges],
        "median_current_a": float(np.median(current)),
        "declared_off": off_declared,
        "fitted_off": off_fitted,
        "text": (
            f"Near rest, at gaps of {edges[0] * 1e3:.2f} to {edges[1] * 1e3:.2f} mm, the current is off i(x) of the "
            f"declared plant by {off_declared:.1%} in the median, and off that of the fit by {off_fitted:.1%}."
        ),
    }
