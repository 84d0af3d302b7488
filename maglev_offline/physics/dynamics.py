"""The nonlinear suspension dynamics on numpy arrays and torch tensors alike.

Source: Zhao et al., Sec. II-B, in absolute coordinates and for L(x) = L0 + c / (x + a):

    m x''    = m g - c i^2 / (2 (x + a)^2) + f
    L(x) i'  = u - R i + c i x' / (x + a)^2
"""

from typing import Any, Literal, NamedTuple

from maglev_offline.physics.parameters import Plant

Integrator = Literal["euler", "rk4"]

Field = Any
"""A float, a numpy array or a torch tensor; all fields of one call broadcast against each other."""


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
    return State(*(value + dt_s * slope for value, slope in zip(state, rate, strict=True)))


def stop(plant: Plant, state: State) -> State:
    """Keep the gap between the mechanical stops (inelastic: no velocity into a stop) and the current >= 0."""
    gap, velocity = state.gap_m, state.velocity_m_s
    into_stop = ((gap <= plant.gap_min_m) & (velocity < 0)) | ((gap >= plant.gap_max_m) & (velocity > 0))
    return State(
        gap.clip(plant.gap_min_m, plant.gap_max_m),
        velocity * ~into_stop,
        state.current_a.clip(0.0, None),
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

    `state` fields are arrays or tensors of one shape (floats will not do: the stops use `clip`).
    `euler` is the paper's scheme at 1 ms; `rk4` is the classical Runge-Kutta scheme. Results depend on the choice.
    """
    k1 = derivative(plant, state, voltage_v, force_n)
    if integrator == "euler":
        return stop(plant, _advance(state, k1, dt_s))
    k2 = derivative(plant, _advance(state, k1, dt_s / 2), voltage_v, force_n)
    k3 = derivative(plant, _advance(state, k2, dt_s / 2), voltage_v, force_n)
    k4 = derivative(plant, _advance(state, k3, dt_s), voltage_v, force_n)
    mean = State(*((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)))
    return stop(plant, _advance(state, mean, dt_s))
