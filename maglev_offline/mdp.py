"""The decision process: state, action, cost and termination. ONE definition for logs and for the simulator.

Source: Zhao et al., Sec. III. What the paper leaves open is read as docs/decisions/0002-readings-of-the-paper.md says.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from maglev_offline.physics.dynamics import Integrator, State, in_contact
from maglev_offline.physics.parameters import Plant
from maglev_offline.settings import Settings

Array = NDArray[np.float64]

STATE_NAMES = ("gap_error_m", "gap_velocity_m_s", "current_error_a")
"""The state s = (x - x_eq, dx/dt, i - i_eq), in this order wherever it is stored."""


START_GAPS_M = tuple(round(0.004 + k * 0.011 / 9, 6) for k in range(10))
"""The starts on which controllers and agents are compared, unless a recipe names others: ten from 4 to 15 mm."""


MOST_STEPS = 1e9
"""An episode of more decisions, or a decision of more plant steps, is a slip of the pen."""


class Mdp(Settings):
    """Everything that turns the plant into a decision process.

    The cost of one plant step is rho1 z1^2 + rho2 z2^2 + rho3 v^2 (paper, Sec. III) with v = u - u_eq; the cost of a
    decision is the sum over the plant steps for which it holds the voltage, so returns are comparable between
    control periods.
    """

    plant_step_ms: float = Field(default=1.0, gt=0)
    control_period_ms: float = Field(default=10.0, gt=0)
    integrator: Integrator = "euler"
    voltage_limit_v: float = Field(default=200.0, gt=0)
    cost_gap_per_m2: float = Field(default=6000.0, ge=0)
    cost_velocity_s2_per_m2: float = Field(default=1.0, ge=0)
    cost_voltage_per_v2: float = Field(default=7.5e-8, ge=0)
    discount: float = Field(default=0.9, gt=0, lt=1)
    gap_scale_m: float = Field(default=0.0025, gt=0)
    velocity_scale_m_s: float = Field(default=0.075, gt=0)
    current_scale_a: float = Field(default=3.75, gt=0)
    force_noise_std_n: float = Field(default=0.0, ge=0)
    start_gap_m: tuple[float, float] = (0.004, 0.0155)
    episode_duration_s: float = Field(default=0.5, gt=0)
    terminate_on_contact: bool = False
    contact_penalty: float = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _times_fit(self) -> "Mdp":
        ratio = self.control_period_ms / self.plant_step_ms
        if not 1 <= ratio < MOST_STEPS or abs(ratio - round(ratio)) > 1e-9:
            raise ValueError(
                f"control_period_ms = {self.control_period_ms:g} must be a whole multiple of "
                f"plant_step_ms = {self.plant_step_ms:g}"
            )
        decisions = self.episode_duration_s * 1e3 / self.control_period_ms
        if not 1 <= decisions < MOST_STEPS or abs(decisions - round(decisions)) > 1e-6:
            raise ValueError(
                f"episode_duration_s = {self.episode_duration_s:g} must hold a whole number of control periods "
                f"of {self.control_period_ms:g} ms, at most {MOST_STEPS:g}"
            )
        if self.start_gap_m[0] > self.start_gap_m[1]:
            raise ValueError("start_gap_m must be [smallest, largest]")
        return self

    @property
    def plant_step_s(self) -> float:
        """Duration of one plant step, s."""
        return self.plant_step_ms / 1e3

    @property
    def plant_steps_per_decision(self) -> int:
        """How many plant steps one decision holds its voltage for."""
        return round(self.control_period_ms / self.plant_step_ms)

    @property
    def decisions_per_episode(self) -> int:
        """Length of an episode in decisions; the end of an episode is a time-out, so targets bootstrap."""
        return round(self.episode_duration_s * 1e3 / self.control_period_ms)

    @property
    def state_scale(self) -> Array:
        """What divides the state before any network sees it, shape [3], SI units."""
        return np.array([self.gap_scale_m, self.velocity_scale_m_s, self.current_scale_a])


def deviation(plant: Plant, state: State, set_point_m: Any = None) -> Array:
    """State as deviation from the equilibrium at the set-point, shape [..., 3], SI units.

    `set_point_m` broadcasts against the fields of `state` and defaults to the plant's own.
    """
    point = plant.equilibrium(set_point_m)
    parts = (state.gap_m - point.gap_m, state.velocity_m_s, state.current_a - point.current_a)
    z = np.empty((*np.broadcast(*parts).shape, 3))
    for k, part in enumerate(parts):
        z[..., k] = part
    return z


def stage_cost(mdp: Mdp, z: Array, v: Array) -> Array:
    """Cost of one plant step: z of shape [..., 3] in SI units, v = u - u_eq of shape [...] in volt."""
    cost: Array = (
        mdp.cost_gap_per_m2 * z[..., 0] ** 2
        + mdp.cost_velocity_s2_per_m2 * z[..., 1] ** 2
        + mdp.cost_voltage_per_v2 * v**2
    )
    return cost


def row_cost(mdp: Mdp, z: Array, v: Array) -> Array:
    """Cost c(s_k, u_k) of a logged row, taken as one decision whose state does not move (the paper's reading)."""
    return mdp.plant_steps_per_decision * stage_cost(mdp, z, v)


def observation(mdp: Mdp, z: Array) -> Array:
    """What the networks see: the deviation over its scale, shape [..., 3], dimensionless."""
    scaled: Array = z / mdp.state_scale
    return scaled


def action(mdp: Mdp, v: Array) -> Array:
    """Voltage deviation in volt to the action; inside the voltage limit it lies in [-1, 1]."""
    return v / mdp.voltage_limit_v


def voltage(mdp: Mdp, plant: Plant, act: Array) -> Array:
    """Action in [-1, 1] to the total coil voltage u = u_eq + v, in volt."""
    return plant.equilibrium().voltage_v + mdp.voltage_limit_v * act


def contact(plant: Plant, gap_m: Array) -> NDArray[np.bool_]:
    """Whether the magnet touches a stop, to a micrometre."""
    touching: NDArray[np.bool_] = in_contact(plant, gap_m, tolerance_m=1e-6)
    return touching
