"""Close the loop: a controller on the nonlinear or on the linearised plant, a batch of starts at once."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.control.feedback import Controller, within
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import Integrator, State, step
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
PlantKind = Literal["nonlinear", "linear"]

FARTHEST = 1e6
"""A linear loop that diverges is held at this deviation, in SI units: it has no stops of its own."""


@dataclass(frozen=True)
class Trajectory:
    """A response in absolute SI units: times [steps + 1], states [steps + 1, n], total coil voltage [steps, n]."""

    time_s: Array
    gap_m: Array
    velocity_m_s: Array
    current_a: Array
    voltage_v: Array

    def until(self, duration_s: float) -> "Trajectory":
        """The first `duration_s` of it."""
        steps = min(round(duration_s / (self.time_s[1] - self.time_s[0])), len(self.voltage_v))
        part = np.s_[: steps + 1]
        return Trajectory(
            self.time_s[part], self.gap_m[part], self.velocity_m_s[part], self.current_a[part], self.voltage_v[:steps]
        )


def regulate(
    plant: Plant,
    mdp: Mdp,
    controller: Controller,
    start_gap_m: Array,
    duration_s: float,
    *,
    plant_kind: PlantKind = "nonlinear",
    control_period_s: float | None = None,
    integrator: Integrator | None = None,
    force_n: Array | None = None,
    limited: bool = True,
    actual: Plant | None = None,
) -> Trajectory:
    """Bring magnets to the set-point that start at rest at `start_gap_m` [n] with the current of the set-point.

    The controller is called each `control_period_s` (default: each plant step) and its voltage is held in between,
    within +-mdp.voltage_limit_v about u_eq unless `limited` is false. `integrator` defaults to the process's own.
    `force_n`: disturbance on the mass, shape [steps, n] or [steps, 1]. `actual`: the plant that moves, where it is
    another than the one that set-point, limits and controller go by; its fields may be arrays of shape [n].
    """
    dt, point = mdp.plant_step_s, plant.equilibrium()
    steps, hold = round(duration_s / dt), 1 if control_period_s is None else round(control_period_s / dt)
    start = np.asarray(start_gap_m, dtype=np.float64)
    state = State(start.copy(), np.zeros_like(start), np.full_like(start, point.current_a))
    moving, kind = actual or plant, _Nonlinear if plant_kind == "nonlinear" else _Linear
    advance = kind(moving, dt, integrator or mdp.integrator)
    states, voltages = np.empty((steps + 1, 3, start.size)), np.empty((steps, start.size))
    states[0] = state
    memory = controller.start(process.deviation(plant, state))
    v = np.zeros_like(start)
    for k in range(steps):
        if k % hold == 0:
            v, memory = controller.control(process.deviation(plant, state), memory, hold * dt)
            if limited:
                v = within(v, mdp.voltage_limit_v)
        force = 0.0 if force_n is None else force_n[k]
        state = advance(state, point.voltage_v + v, force)
        states[k + 1], voltages[k] = state, point.voltage_v + v
    time_s: Array = np.arange(steps + 1, dtype=np.float64) * np.float64(dt)
    return Trajectory(time_s, states[:, 0], states[:, 1], states[:, 2], voltages)


@dataclass(frozen=True)
class _Nonlinear:
    plant: Plant
    dt_s: float
    integrator: Integrator

    def __call__(self, state: State, voltage_v: Array, force_n: Array | float) -> State:
        return step(self.plant, state, voltage_v, self.dt_s, force_n=force_n, integrator=self.integrator)


class _Linear:
    """The linearised plant, by forward Euler or (`rk4`) exactly for a held voltage."""

    def __init__(self, plant: Plant, dt_s: float, integrator: Integrator) -> None:
        from scipy.linalg import expm

        linear = linearise(plant)
        rate = np.zeros((5, 5))
        rate[:3, :3], rate[:3, 3:4] = linear.a, linear.b
        rate[1, 4] = 1 / plant.mass_kg
        self._step = (np.eye(5) + dt_s * rate if integrator == "euler" else expm(dt_s * rate))[:3]
        self._rest = np.array(plant.equilibrium())  # gap, current, voltage

    def __call__(self, state: State, voltage_v: Array, force_n: Array | float) -> State:
        gap, current, voltage = self._rest
        z = np.empty((5, len(voltage_v)))
        z[0], z[1], z[2] = state.gap_m - gap, state.velocity_m_s, state.current_a - current
        z[3], z[4] = voltage_v - voltage, force_n
        z1, z2, z3 = within(self._step @ z, FARTHEST)
        return State(z1 + gap, z2, z3 + current)
