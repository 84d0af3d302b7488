"""The plant with what drives it: five states, their rates, and what noise does to them.

State x = (gap, velocity, current, memory, disturbance), in SI units. `memory` is the law's integral of the gap error
in m s or, where no law is known, how far the voltage is from the line between two samples, in volt. `disturbance` is
the acceleration, positive downward, that a load beside the plant's mass makes at rest; it fades to zero. Away from
rest it acts in the ratio of the magnet's pull to the weight: a heavier load is not drawn down, it is drawn up less.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.control.feedback import closed_loop_poles
from maglev_offline.control.observer import jacobian
from maglev_offline.curate.recovery.settings import RecoverySettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State, inductance, step
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

STATES = 5
GAP, VELOCITY, CURRENT, MEMORY, DISTURBANCE = range(STATES)

LONGEST_LEAF_S = 0.01
"""Over so long a time at most is the motion linearised at one place, its middle; less where a pole is fast."""

LINE_MEMORY = 0.25
"""Share of the period for which the voltage remembers how far it was from the line."""

MOST_CURRENT = 5.0
"""Current over that at rest beyond which a load's part of the pull is not followed."""


class Drive(NamedTuple):
    """What n intervals between samples are driven by: set-point, the voltage at both ends, and its change, [n] each."""

    set_point_m: Array
    begin_v: Array
    end_v: Array
    set_point_change_m: Array

    def part(self, rows: slice | NDArray[np.int64]) -> "Drive":
        """Some of them."""
        return Drive(*(x[rows] for x in self))


@dataclass(frozen=True)
class Model:
    """The plant under a law: `gain` [4] of (z1, z2, z3, integral), or None where no law is known.

    `period_s`: of the samples. `line_std_v`: how far the voltage may be from the line, without a law.
    """

    plant: Plant
    mdp: Mdp
    settings: RecoverySettings
    gain: Array | None
    period_s: float
    line_std_v: float

    @property
    def scale(self) -> Array:
        """What is a large state [5], SI units: covariances are held in these units, where they are of order one."""
        if self.gain is None:
            memory = self.line_std_v
        else:
            memory = 0.1 * self.mdp.voltage_limit_v / max(abs(self.gain[3]), 1e-3)
        return np.array([*self.mdp.state_scale, memory, self.settings.disturbance_std_m_s2])

    @property
    def prior_std(self) -> Array:
        """What is known of a state before anything was measured: nothing much; of the disturbance its own spread."""
        known = np.array([4.0, 4.0, 4.0, 4.0, 1.0]) if self.gain is not None else np.array([4.0, 4.0, 4.0, 1.0, 1.0])
        prior: Array = self.scale * known
        return prior

    @cached_property
    def leaf_s(self) -> float:
        """For how long exp(J h) is taken from its series: J h is about one for the fastest pole of the loop at most."""
        return min(LONGEST_LEAF_S, 1.0 / float(np.abs(self.poles).max()))

    @cached_property
    def poles(self) -> NDArray[np.complex128]:
        """Poles of the linearised plant under the law in rad/s, of the plant alone where no law is known."""
        return closed_loop_poles(linearise(self.plant), np.zeros(4) if self.gain is None else self.gain)

    def voltage(self, x: Array, drive: Drive, after_s: float) -> tuple[Array, NDArray[np.bool_]]:
        """Total voltage [n] of the states x [n, 5], `after_s` into the interval, and where it is not at its limit."""
        if self.gain is None:
            line = drive.begin_v + after_s / self.period_s * (drive.end_v - drive.begin_v)
            return line + x[:, MEMORY], np.ones(len(x), dtype=bool)
        rest = self.plant.equilibrium(drive.set_point_m)
        v = (
            self.gain[0] * (x[:, GAP] - drive.set_point_m)
            + self.gain[1] * x[:, VELOCITY]
            + self.gain[2] * (x[:, CURRENT] - rest.current_a)
            + self.gain[3] * x[:, MEMORY]
        )
        limit = self.mdp.voltage_limit_v
        return rest.voltage_v + np.clip(v, -limit, limit), np.abs(v) <= limit

    def advance(self, x: Array, drive: Drive, after_s: float, dt_s: float) -> Array:
        """x [n, 5] one step later; the voltage is held for the step, as a digital controller holds it."""
        voltage, free = self.voltage(x, drive, after_s)
        force = self.plant.mass_kg * x[:, DISTURBANCE] * self._pull(x)
        now = State(x[:, GAP], x[:, VELOCITY], x[:, CURRENT])
        moved = step(self.plant, now, voltage, dt_s, force_n=force, integrator="rk4")
        if self.gain is None:
            memory = x[:, MEMORY] * np.exp(-dt_s / (LINE_MEMORY * self.period_s))
        else:
            memory = x[:, MEMORY] + dt_s * free * (x[:, GAP] - drive.set_point_m)
        fading = np.exp(-dt_s / self.settings.disturbance_time_s)
        return np.stack([*moved, memory, fading * x[:, DISTURBANCE]], axis=1)

    def _pull(self, x: Array) -> Array:
        """The magnet's force over its force at rest at that gap, [n], bounded for states that run away."""
        pull: Array = np.clip(x[:, CURRENT] / self.plant.equilibrium(x[:, GAP]).current_a, 0.0, MOST_CURRENT) ** 2
        return pull

    def rate_jacobian(self, x: Array, drive: Drive, after_s: float) -> Array:
        """d(rate of x)/dx [n, 5, 5]."""
        voltage, free = self.voltage(x, drive, after_s)
        j = np.zeros((len(x), STATES, STATES))
        j[:, :3, :3] = jacobian(self.plant, State(x[:, GAP], x[:, VELOCITY], x[:, CURRENT]), voltage)
        pull, load = self._pull(x), x[:, DISTURBANCE]
        j[:, VELOCITY, DISTURBANCE] = pull
        j[:, VELOCITY, GAP] -= 2 * load * pull / (x[:, GAP] + self.plant.pole_offset_m)
        j[:, VELOCITY, CURRENT] += 2 * load * pull / np.maximum(x[:, CURRENT], 1e-3)
        j[:, DISTURBANCE, DISTURBANCE] = -1 / self.settings.disturbance_time_s
        per_volt = 1 / inductance(self.plant, x[:, GAP])
        if self.gain is None:
            j[:, CURRENT, MEMORY] = per_volt
            j[:, MEMORY, MEMORY] = -1 / (LINE_MEMORY * self.period_s)
        else:
            j[:, CURRENT, :4] += (free * per_volt)[:, None] * self.gain
            j[:, MEMORY, GAP] = free
        return j

    def noise(self, x: Array, drive: Drive) -> Array:
        """What white noise adds to the variance of each state in a second, [n, 5]."""
        s, dt = self.settings, self.mdp.plant_step_s
        added = np.empty((len(x), STATES))
        added[:, GAP] = 1e-10 * self.scale[GAP] ** 2  # against a covariance of no width
        added[:, VELOCITY] = s.acceleration_noise_std_m_s2**2 * dt
        volt2_s = np.full(len(x), s.voltage_noise_std_v**2 * dt)
        if self.gain is None:
            added[:, MEMORY] = 2 * self.line_std_v**2 / (LINE_MEMORY * self.period_s)
        else:
            # Somewhere between the samples the set-point has changed, and the law has followed it.
            volt2_s += (self.gain[0] * drive.set_point_change_m) ** 2 * self.period_s
            added[:, MEMORY] = (0.01 * self.scale[MEMORY]) ** 2
        added[:, CURRENT] = volt2_s / inductance(self.plant, x[:, GAP]) ** 2
        added[:, DISTURBANCE] = 2 * s.disturbance_std_m_s2**2 / s.disturbance_time_s
        return added
