"""The suspension as an environment: a batch of independent magnets, and the single one that gymnasium knows."""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.mdp import Mdp
from maglev_offline.physics.disturbance import force_noise
from maglev_offline.physics.dynamics import State, step
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]


class SuspensionBatch:
    """Independent magnets that are stepped together; holds their state and nothing else.

    Actions in [-1, 1], shape [n]; observations shape [n, 3]; costs shape [n]. Contact with a stop continues
    the episode unless the recipe says otherwise.
    """

    def __init__(self, plant: Plant, mdp: Mdp, size: int) -> None:
        self.plant, self.mdp = plant, mdp
        self._u_eq = plant.equilibrium().voltage_v
        self.state = self._at_rest(np.full(size, plant.set_point_m))

    def _at_rest(self, gap_m: Array) -> State:
        """At rest at `gap_m` with the current of the set-point, as an episode starts."""
        return State(gap_m.copy(), np.zeros_like(gap_m), np.full_like(gap_m, self.plant.equilibrium().current_a))

    def reset(self, gap_m: Array, where: NDArray[np.bool_] | None = None) -> Array:
        """Start an episode at `gap_m` [n] for the magnets in `where` (default: all); return all observations."""
        fresh = self._at_rest(gap_m)
        if where is None:
            self.state = fresh
        else:
            self.state = State(*(np.where(where, a, b) for a, b in zip(fresh, self.state, strict=True)))
        return self.observe()

    def deviation(self) -> Array:
        """The state as deviation from the equilibrium, shape [n, 3], SI units."""
        return process.deviation(self.plant, self.state)

    def observe(self) -> Array:
        """The scaled state, shape [n, 3]."""
        return process.observation(self.mdp, self.deviation())

    def step(self, act: Array, force_n: Array | None = None) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Hold the action for one control period.

        `force_n`: disturbance, shape [plant steps per decision, n]. Returns the next observation, the cost summed
        over the plant steps, and whether a stop was touched.
        """
        plant, mdp = self.plant, self.mdp
        v = mdp.voltage_limit_v * np.clip(act, -1.0, 1.0)
        u = self._u_eq + v
        cost = np.zeros_like(v)
        touched = np.zeros(v.shape, dtype=bool)
        for k in range(mdp.plant_steps_per_decision):
            cost += process.stage_cost(mdp, self.deviation(), v)
            force = 0.0 if force_n is None else force_n[k]
            self.state = step(plant, self.state, u, mdp.plant_step_s, force_n=force, integrator=mdp.integrator)
            touched |= process.contact(plant, self.state.gap_m)
        return self.observe(), cost + mdp.contact_penalty * touched, touched


class SuspensionEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One magnet as `gymnasium.make("maglev_offline/Suspension-v0")`; reward = -cost.

    Observation: (gap error, gap velocity, current error) over the recipe's scales. Action: voltage deviation over
    the voltage limit, in [-1, 1]. `info` holds the SI values.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (declared so by gymnasium)

    def __init__(self, plant: Plant | None = None, mdp: Mdp | None = None) -> None:
        self.batch = SuspensionBatch(plant or Plant(), mdp or Mdp(), 1)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._decisions = 0

    def _info(self) -> dict[str, Any]:
        state = self.batch.state
        return {name: float(value[0]) for name, value in state._asdict().items()}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start at a gap drawn from the recipe's range, or at `options["gap_m"]`."""
        super().reset(seed=seed)
        gap = (options or {}).get("gap_m", self.np_random.uniform(*self.batch.mdp.start_gap_m))
        self._decisions = 0
        return self.batch.reset(np.array([gap]))[0].astype(np.float32), self._info()

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold the action for one control period; the horizon truncates, contact terminates where asked."""
        mdp = self.batch.mdp
        force = force_noise(self.np_random, (mdp.plant_steps_per_decision, 1), mdp.force_noise_std_n)
        seen, cost, touched = self.batch.step(np.asarray(action, dtype=np.float64).reshape(1), force)
        self._decisions += 1
        terminated = bool(touched[0]) and mdp.terminate_on_contact
        truncated = self._decisions >= mdp.decisions_per_episode
        info = {**self._info(), "cost": float(cost[0]), "contact": bool(touched[0])}
        return seen[0].astype(np.float32), -float(cost[0]), terminated, truncated, info


class SuspensionVectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """Many magnets in one batch: `gymnasium.make_vec(ID, num_envs=n, vectorization_mode="vector_entry_point")`.

    Observations [n, 3], actions [n, 1], rewards [n]. An episode that has ended starts anew at the next step, whose
    action is not used and whose reward is 0 (gymnasium's `NEXT_STEP`). `info` holds SI values, each of shape [n].
    """

    metadata: dict[str, Any] = {"autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, num_envs: int = 1, plant: Plant | None = None, mdp: Mdp | None = None) -> None:
        single = SuspensionEnv(plant, mdp)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = single.observation_space, single.action_space
        self.observation_space = gymnasium.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gymnasium.vector.utils.batch_space(self.single_action_space, num_envs)
        self.batch = SuspensionBatch(single.batch.plant, single.batch.mdp, num_envs)
        self._decisions = np.zeros(num_envs, dtype=np.int64)
        self._ended = np.zeros(num_envs, dtype=bool)

    def _info(self) -> dict[str, Any]:
        return {name: value.copy() for name, value in self.batch.state._asdict().items()}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start every magnet at a gap drawn from the recipe's range, or at `options["gap_m"]` (a number or [n])."""
        super().reset(seed=seed)
        given = (options or {}).get("gap_m")
        low, high = self.batch.mdp.start_gap_m
        gap = self.np_random.uniform(low, high, self.num_envs) if given is None else np.full(self.num_envs, given)
        self._decisions[:], self._ended[:] = 0, False
        return self.batch.reset(gap.astype(np.float64)).astype(np.float32), self._info()

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Hold the actions for one control period; magnets whose episode had ended start anew instead."""
        mdp, fresh = self.batch.mdp, self._ended
        force = force_noise(self.np_random, (mdp.plant_steps_per_decision, self.num_envs), mdp.force_noise_std_n)
        seen, cost, touched = self.batch.step(np.asarray(actions, dtype=np.float64).reshape(self.num_envs), force)
        if fresh.any():
            seen = self.batch.reset(self.np_random.uniform(*mdp.start_gap_m, self.num_envs), fresh)
        cost, touched = np.where(fresh, 0.0, cost), touched & ~fresh
        self._decisions = np.where(fresh, 0, self._decisions + 1)
        terminated = touched & mdp.terminate_on_contact
        truncated = self._decisions >= mdp.decisions_per_episode
        self._ended = terminated | truncated
        info = {**self._info(), "cost": cost, "contact": touched}
        return seen.astype(np.float32), -cost, terminated, truncated, info


def register() -> None:
    """Make the environment known to gymnasium; called when the package's `env` module is imported."""
    if "maglev_offline/Suspension-v0" not in gymnasium.registry:
        gymnasium.register(
            "maglev_offline/Suspension-v0",
            entry_point="maglev_offline.env:SuspensionEnv",
            vector_entry_point="maglev_offline.env:SuspensionVectorEnv",
        )


register()
