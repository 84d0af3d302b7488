"""An extended Kalman filter that sees the gap only, in front of any state feedback (paper, Sec. VI-B)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from maglev_offline import mdp as process
from maglev_offline.control.feedback import IntegralFeedback
from maglev_offline.physics.dynamics import State, inductance, step
from maglev_offline.physics.parameters import Plant
from maglev_offline.settings import Settings

Array = NDArray[np.float64]

_LOST = 1e6
"""Bound on estimates and covariances, SI units: a filter in a loop that diverges stays finite."""


class ObserverSettings(Settings):
    """What the filter believes about noise, per step: of the gap sensor, of the force over the mass, of the voltage.

    0.7 m/s^2 are the paper's 500 N on 700 kg. The current at the start is known to a share of that at the set-point.
    """

    gap_noise_std_m: float = Field(default=1e-5, gt=0)
    acceleration_noise_std_m_s2: float = Field(default=0.7, gt=0)
    voltage_noise_std_v: float = Field(default=1.0, gt=0)
    start_velocity_std_m_s: float = Field(default=0.05, gt=0)
    start_current_std_share: float = Field(default=0.2, gt=0)


class Estimate(NamedTuple):
    """What the filter knows: the predicted state (fields [n]), its covariance [n, 3, 3], and the law's memory."""

    state: State
    covariance: Array
    law: Array


def jacobian(plant: Plant, state: State, voltage_v: Array) -> Array:
    """d(state rate)/d(state) of the nonlinear dynamics, shape [n, 3, 3]."""
    reach = state.gap_m + plant.pole_offset_m
    coil_h = inductance(plant, state.gap_m)
    slope = plant.inductance_slope_h_m
    back_emf = slope * state.current_a / reach**2
    rate = (voltage_v - plant.resistance_ohm * state.current_a + back_emf * state.velocity_m_s) / coil_h
    j = np.zeros((*np.shape(reach), 3, 3))
    j[..., 0, 1] = 1.0
    j[..., 1, 0] = slope * state.current_a**2 / (plant.mass_kg * reach**3)
    j[..., 1, 2] = -slope * state.current_a / (plant.mass_kg * reach**2)
    j[..., 2, 0] = (-2 * back_emf * state.velocity_m_s / reach + rate * slope / reach**2) / coil_h
    j[..., 2, 1] = back_emf / coil_h
    j[..., 2, 2] = (slope * state.velocity_m_s / reach**2 - plant.resistance_ohm) / coil_h
    return j


@dataclass(frozen=True)
class ObserverFeedback:
    """State feedback on the filter's estimate; of z it uses the gap alone.

    The estimate starts at the measured gap, at rest, with the current of the set-point. The covariance is updated
    in Joseph's form, which keeps it symmetric and positive.
    """

    plant: Plant
    law: IntegralFeedback
    settings: ObserverSettings

    def start(self, z: Array) -> Estimate:
        """Believe the first gap, and nothing else much."""
        point, s = self.plant.equilibrium(), self.settings
        rest = np.zeros(z.shape[:-1])
        state = State(point.gap_m + z[..., 0], rest, np.full_like(rest, point.current_a))
        spread = np.array([s.gap_noise_std_m, s.start_velocity_std_m_s, s.start_current_std_share * point.current_a])
        return Estimate(state, np.broadcast_to(np.diag(spread**2), (*rest.shape, 3, 3)), self.law.start(z))

    def control(self, z: Array, memory: Estimate, dt_s: float) -> tuple[Array, Estimate]:
        """Correct by the measured gap z1, feed the estimate back, predict to the next call."""
        corrected, covariance = self._correct(memory, self.plant.equilibrium().gap_m + z[..., 0])
        v, law = self.law.control(process.deviation(self.plant, corrected), memory.law, dt_s)
        u = self.plant.equilibrium().voltage_v + v
        f = np.eye(3) + dt_s * jacobian(self.plant, corrected, u)
        coil_h = inductance(self.plant, corrected.gap_m)
        noise = np.zeros_like(covariance)
        noise[..., 1, 1] = (dt_s * self.settings.acceleration_noise_std_m_s2) ** 2
        noise[..., 2, 2] = (dt_s * self.settings.voltage_noise_std_v / coil_h) ** 2
        predicted = step(self.plant, corrected, u, dt_s, integrator="rk4")
        spread = np.clip(f @ covariance @ f.swapaxes(-1, -2) + noise, -_LOST, _LOST)
        return v, Estimate(predicted, spread, law)

    def _correct(self, memory: Estimate, gap_m: Array) -> tuple[State, Array]:
        p, noise = memory.covariance, self.settings.gap_noise_std_m**2
        kalman = p[..., :, 0] / (p[..., 0, 0] + noise)[..., None]
        surprise = gap_m - memory.state.gap_m
        state = State(*(x + kalman[..., k] * surprise for k, x in enumerate(memory.state)))
        keep = np.broadcast_to(np.eye(3), p.shape).copy()
        keep[..., :, 0] -= kalman
        joseph = keep @ p @ keep.swapaxes(-1, -2) + noise * kalman[..., :, None] * kalman[..., None, :]
        floor = 0.5 * self.plant.gap_min_m  # a wild estimate must not reach the pole of L(x)
        sane = State(
            np.clip(state.gap_m, floor, _LOST),
            np.clip(state.velocity_m_s, -_LOST, _LOST),
            np.clip(state.current_a, 0.0, _LOST),
        )
        return sane, joseph
