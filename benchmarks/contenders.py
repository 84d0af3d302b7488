"""The ways to simulate that `simulation.py` times: ours, and the two that one would write without a batch.

All follow the same law from the same starts without noise; the plant's stops hold after every plant step in each.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from maglev_offline.control.lqi import lqr_for_mdp
from maglev_offline.env import SuspensionBatch
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import Integrator, State, derivative, step, stop
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
Simulate = Callable[[Array], Array]
"""From the gaps [n] at which episodes start to their final states [3, n], SI units."""


@dataclass(frozen=True)
class Task:
    """One plant, one process, one law: v = gain . z within the voltage limit, held for a control period."""

    plant: Plant
    mdp: Mdp
    gain: Array
    scaled_gain: tuple[float, float, float]
    """From the observation to the action; worked out once, or the single environment would pay for it every step."""

    @classmethod
    def of(cls, period_ms: int, steps: int, integrator: Integrator) -> "Task":
        """Return the paper's plant without noise, under the best linear law for its control period."""
        plant = Plant()
        mdp = Mdp(control_period_ms=period_ms, episode_duration_s=steps / 1000, integrator=integrator)
        gain = lqr_for_mdp(plant, mdp).gain[:3]
        a, b, c = (gain * mdp.state_scale / mdp.voltage_limit_v).astype(np.float32).tolist()
        return cls(plant, mdp, gain, (a, b, c))

    def action(self, seen: NDArray[Any]) -> NDArray[np.float32]:
        """Return actions [n] for observations [n, 3], element by element so that one is rounded as many are."""
        a, b, c = self.scaled_gain
        seen = seen.astype(np.float32)
        act: NDArray[np.float32] = (a * seen[..., 0] + b * seen[..., 1] + c * seen[..., 2]).clip(-1.0, 1.0)
        return act

    def voltage(self, state: State) -> Any:
        """Return the coil voltage for arrays or tensors of the state."""
        (k1, k2, k3), point, limit = self.gain.tolist(), self.plant.equilibrium(), self.mdp.voltage_limit_v
        v = k1 * (state.gap_m - point.gap_m) + k2 * state.velocity_m_s + k3 * (state.current_a - point.current_a)
        return point.voltage_v + v.clip(-limit, limit)

    def at_rest(self, gap_m: Array) -> State:
        """Return the state in which episodes start."""
        return State(gap_m.copy(), np.zeros_like(gap_m), np.full_like(gap_m, self.plant.equilibrium().current_a))


def batch(task: Task) -> Simulate:
    """All episodes as one `SuspensionBatch`: observations, costs and contacts of every step included."""

    def simulate(gap_m: Array) -> Array:
        magnets = SuspensionBatch(task.plant, task.mdp, gap_m.size)
        seen = magnets.reset(gap_m)
        for _ in range(task.mdp.decisions_per_episode):
            seen, _, _ = magnets.step(task.action(seen).astype(np.float64))
        return np.stack(magnets.state)

    return simulate


def raw(task: Task, kind: str) -> Simulate:
    """All episodes through `physics.dynamics.step` alone, on numpy arrays or on torch tensors."""
    mdp = task.mdp

    def simulate(gap_m: Array) -> Array:
        state = task.at_rest(gap_m)
        if kind == "torch":
            state = State(*(torch.from_numpy(field) for field in state))
        with torch.inference_mode():
            for _ in range(mdp.decisions_per_episode):
                u = task.voltage(state)
                for _ in range(mdp.plant_steps_per_decision):
                    state = step(task.plant, state, u, mdp.plant_step_s, integrator=mdp.integrator)
        return np.stack([np.asarray(field) for field in state])

    return simulate


def one_env(task: Task) -> Simulate:
    """One environment as `gymnasium.make` gives it, one episode after another."""
    env = gymnasium.make("maglev_offline/Suspension-v0", plant=task.plant, mdp=task.mdp)

    def simulate(gap_m: Array) -> Array:
        finals = []
        for gap in gap_m.tolist():
            seen, info = env.reset(options={"gap_m": gap})
            ended = False
            while not ended:
                seen, _, terminated, truncated, info = env.step(task.action(seen)[None])
                ended = terminated or truncated
            finals.append([info[name] for name in State._fields])
        return np.array(finals).T

    return simulate


def ivp_one_by_one(task: Task) -> Simulate:
    """One episode after another, `solve_ivp` (RK45) once for every plant step, on plain floats and without a cost.

    Three numbers are too few for arrays. The tolerances are scipy's defaults, the first step is given, which spares
    it a search. Once for every decision would do for a plant without stops, and with a current of either sign.
    """
    plant, mdp, point = task.plant, task.mdp, task.plant.equilibrium()
    c, a, r, g = plant.inductance_slope_h_m, plant.pole_offset_m, plant.resistance_ohm, plant.gravity_m_s2
    l0, pull = plant.inductance_offset_h, plant.inductance_slope_h_m / (2 * plant.mass_kg)
    (k1, k2, k3), limit, dt = task.gain.tolist(), mdp.voltage_limit_v, mdp.plant_step_s

    def rate(_: float, y: Array, u: float) -> tuple[float, float, float]:
        gap, velocity, current = y.tolist()
        reach = gap + a
        ratio, slope = current / reach, c / reach
        return velocity, g - pull * ratio * ratio, (u - r * current + slope * ratio * velocity) / (l0 + slope)

    def episode(gap: float) -> tuple[float, float, float]:
        velocity, current = 0.0, point.current_a
        for _ in range(mdp.decisions_per_episode):
            v = k1 * (gap - point.gap_m) + k2 * velocity + k3 * (current - point.current_a)
            u = point.voltage_v + max(-limit, min(limit, v))
            for _ in range(mdp.plant_steps_per_decision):
                solved = solve_ivp(rate, (0.0, dt), (gap, velocity, current), args=(u,), first_step=dt)
                gap, velocity, current = solved.y[:, -1].tolist()
                if (gap <= plant.gap_min_m and velocity < 0) or (gap >= plant.gap_max_m and velocity > 0):
                    velocity = 0.0
                gap, current = max(plant.gap_min_m, min(plant.gap_max_m, gap)), max(0.0, current)
        return gap, velocity, current

    return lambda gap_m: np.array([episode(gap) for gap in gap_m.tolist()]).T


def ivp_one_system(task: Task) -> Simulate:
    """All episodes as one system of 3 n equations, `solve_ivp` (RK45) once for every plant step, without a cost."""
    plant, mdp = task.plant, task.mdp
    dt = mdp.plant_step_s

    def rate(_: float, y: Array, u: Array) -> Array:
        return np.concatenate(derivative(plant, State(*y.reshape(3, -1)), u))

    def simulate(gap_m: Array) -> Array:
        state = task.at_rest(gap_m)
        for _ in range(mdp.decisions_per_episode):
            u = task.voltage(state)
            for _ in range(mdp.plant_steps_per_decision):
                solved = solve_ivp(rate, (0.0, dt), np.concatenate(state), args=(u,), first_step=dt)
                state = stop(plant, State(*solved.y[:, -1].reshape(3, -1)))
        return np.stack(state)

    return simulate
