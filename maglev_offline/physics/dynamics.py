"""The nonlinear suspension dynamics on numpy arrays and torch tensors alike.

Source: Zhao et al., Sec. II-B, in absolute coordinates and for L(x) = L0 + c / (x + a):

    m x''    = m g - c i^2 / (2 (x + a)^2) + f
    L(x) i'  = u - R i + c i x' / (x + a)^2
"""

from typing import Any, Literal, NamedTuple

import numpy as np

from maglev_offline.physics.parameters import Plant

Integrator = Literal["euler", "rk4"]

Field = Any
"""A float, a numpy array or a torch tensor; all fields of one call broadcast against each other."""

FEW = 4
"""RK4 advances up to so many magnets one by one: to call numpy on a few numbers takes longer than to compute them."""


class State(NamedTuple):
    """The plant's state in absolute SI units; every field has the shape of the batch."""

    gap_m: Field
    velocity_m_s: Field
    current_a: Field


def inductance(plant: Plant, gap_m: Field) -> Field:
    """L(x) in henry."""
    return plant.inductance_offset_h + plant.inductance_slope_h_m / (gap_m + plant.pole_offset_m)


def suspension_force(plant: Plant, gap_m: Field, current_a: Field) -> Field:
    """Attraction c i^2 / (2 (x + a)^2) in newton, positive upward (paper, Eq. of the suspension force)."""
    reach = gap_m + plant.pole_offset_m
    return plant.inductance_slope_h_m * current_a * current_a / (2 * reach * reach)


def derivative(plant: Plant, state: State, voltage_v: Field, force_n: Field = 0.0) -> State:
    """Time derivative of the state; `force_n` is a disturbance on the mass, positive downward."""
    reach = state.gap_m + plant.pole_offset_m
    slope_over_reach = plant.inductance_slope_h_m / reach
    ratio = state.current_a / reach
    acceleration = (
        plant.gravity_m_s2 - plant.inductance_slope_h_m / (2 * plant.mass_kg) * ratio * ratio + force_n / plant.mass_kg
    )
    current_rate = (
        voltage_v - plant.resistance_ohm * state.current_a + slope_over_reach * ratio * state.velocity_m_s
    ) / (plant.inductance_offset_h + slope_over_reach)
    return State(state.velocity_m_s, acceleration, current_rate)


def _advance(state: State, rate: State, dt_s: float) -> State:
    return State(
        state.gap_m + dt_s * rate.gap_m,
        state.velocity_m_s + dt_s * rate.velocity_m_s,
        state.current_a + dt_s * rate.current_a,
    )


def _clip(value: Field, lowest: float, highest: float | None) -> Field:
    """`value.clip`, for floats too and sooner for arrays; NaN stays NaN."""
    if isinstance(value, np.ndarray):
        value = np.maximum(value, lowest)
        return value if highest is None else np.minimum(value, highest)
    if not isinstance(value, float):
        return value.clip(lowest, highest)
    if value < lowest:
        return lowest
    return highest if highest is not None and value > highest else value


def stop(plant: Plant, state: State) -> State:
    """Keep the gap between the mechanical stops (inelastic: no velocity into a stop) and the current >= 0."""
    gap, velocity = state.gap_m, state.velocity_m_s
    into_stop = ((gap <= plant.gap_min_m) & (velocity < 0)) | ((gap >= plant.gap_max_m) & (velocity > 0))
    return State(
        _clip(gap, plant.gap_min_m, plant.gap_max_m),
        velocity * (into_stop ^ True),
        _clip(state.current_a, 0.0, None),
    )


def in_contact(plant: Plant, gap_m: Field, tolerance_m: float = 0.0) -> Field:
    """Whether the gap is at a mechanical stop, within `tolerance_m`."""
    return (gap_m <= plant.gap_min_m + tolerance_m) | (gap_m >= plant.gap_max_m - tolerance_m)


def step(
    plant: Plant,
    state: State,
    voltage_v: Field,
    dt_s: float,
    *,
    force_n: Field = 0.0,
    integrator: Integrator = "euler",
) -> State:
    """Advance by one plant step with the voltage and the force held, then apply the stops.

    `state` fields are floats, or arrays or tensors of one shape.
    `euler` is the paper's scheme at 1 ms; `rk4` is the classical Runge-Kutta scheme. Results depend on the choice.
    """
    if integrator == "rk4" and isinstance(state.gap_m, np.ndarray) and 0 < state.gap_m.size <= FEW:
        few = _one_by_one(plant, state, voltage_v, dt_s, force_n)
        if few is not None:
            return few
    k1 = derivative(plant, state, voltage_v, force_n)
    if integrator == "euler":
        return stop(plant, _advance(state, k1, dt_s))
    k2 = derivative(plant, _advance(state, k1, dt_s / 2), voltage_v, force_n)
    k3 = derivative(plant, _advance(state, k2, dt_s / 2), voltage_v, force_n)
    k4 = derivative(plant, _advance(state, k3, dt_s), voltage_v, force_n)
    mean = State(*[(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)])
    return stop(plant, _advance(state, mean, dt_s))


def _one_by_one(plant: Plant, state: State, voltage_v: Field, dt_s: float, force_n: Field) -> State | None:
    """`step` by RK4 with floats, to the same bits; None where the fields are no plain columns [n]."""
    n = state.gap_m.size
    if any(type(value) is np.ndarray for value in vars(plant).values()):
        return None
    columns = [_floats(field, n) for field in (*state, voltage_v, force_n)]
    if None in columns:
        return None
    try:
        found = [
            step(plant, State(gap, velocity, current), u, dt_s, force_n=f, integrator="rk4")
            for gap, velocity, current, u, f in zip(*columns, strict=True)
        ]
    except ZeroDivisionError:  # numpy has an infinity for it
        return None
    return State(*np.array(found).T)


def _floats(field: Field, n: int) -> list[float] | None:
    """The n values of a number or of an array [1] or [n]; None of anything else."""
    if isinstance(field, int | float):
        return [float(field)] * n
    if not isinstance(field, np.ndarray) or field.dtype != np.float64 or field.ndim != 1:
        return None
    values: list[float] = field.tolist()
    if len(values) == n:
        return values
    return values * n if len(values) == 1 else None
