"""The torch engine: DDPG and TD3 as their modules state them, a block of seeds in every operation."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from maglev_offline.agents import networks
from maglev_offline.agents.adam import Adam
from maglev_offline.agents.ddpg import Ddpg
from maglev_offline.agents.draws import CHUNK, Draws, DrawStreams
from maglev_offline.agents.engine import Nets
from maglev_offline.agents.evaluation import roll_out
from maglev_offline.agents.networks import Network
from maglev_offline.agents.settings import Algorithm, TrainingSettings
from maglev_offline.agents.td3 import Td3
from maglev_offline.control.simulate import Trajectory
from maglev_offline.env import SuspensionBatch
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.buffer import Batch, ReplayBuffer, pack
from maglev_offline.replay.sampling import Mixture

Array = NDArray[np.float64]


class Agent(Protocol):
    """What the loop needs of an algorithm."""

    actor: Network
    critic: Network
    slow_actor: Network
    slow_critic: Network
    actor_adam: Adam
    critic_adam: Adam

    def update(self, batch: Batch, noise: Tensor, step: int) -> None:
        """One gradient step."""


class TorchLearner:
    """A block of seeds; see `engine.Learner`.

    A short block is padded with repetitions of its last seed, so that the arithmetic of a seed never depends on its
    company. `prefill`: packed rows [n, WIDTH] for the first slots of every buffer. Networks and rows are on `device`;
    the environment is not.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        seeds: list[int],
        plant: Plant,
        mdp: Mdp,
        settings: TrainingSettings,
        prefill: NDArray[np.float32] | None = None,
        device: str = "cpu",
    ) -> None:
        self.plant, self.mdp, self.settings, self.device = plant, mdp, settings, device
        self.seeds = len(seeds)
        block = seeds + [seeds[-1]] * (settings.block - len(seeds))
        self.agent: Agent = Ddpg(block, settings, device) if algorithm == "ddpg" else Td3(block, settings, device)
        prefilled = 0 if prefill is None else len(prefill)
        self.buffer = ReplayBuffer(
            len(block),
            min(settings.buffer_capacity, prefilled + settings.steps + 1),
            device,
            n_step=settings.n_step,
            mixture=Mixture(settings.mixing_share, settings.prefill_decay_steps),
        )
        if prefill is not None:
            self.buffer.prefill(prefill)
        self.env = SuspensionBatch(plant, mdp, len(block))
        self.streams = DrawStreams(
            block,
            settings.batch_size,
            mdp.plant_steps_per_decision,
            mdp.force_noise_std_n,
            smoothed=algorithm == "td3",
        )
        self.age = np.full(len(block), mdp.decisions_per_episode)
        self.held = np.zeros(len(block))
        self.seen = self.env.observe()
        self._step = self._told = 0

    @property
    def step(self) -> int:
        """Decisions that every seed has made."""
        return self._step

    def advance(self, steps: int) -> None:
        """Make so many decisions with every seed, and the gradient steps that belong to them."""
        end = self.step + steps
        while self.step < end:
            count = min(CHUNK, end - self.step)
            draws = self.streams.draw(count)
            for within in range(count):
                self.buffer.add(self._decide(draws, within))
                if self.step >= self.settings.exploratory_steps:
                    self._learn(draws, within)
                self._step += 1

    def _decide(self, draws: Draws, within: int) -> NDArray[np.float32]:
        """One decision of every seed; the rows that come of it, [seeds, WIDTH]."""
        mdp, seen = self.mdp, self.seen
        fresh = self.age >= mdp.decisions_per_episode
        if fresh.any():
            low, high = mdp.start_gap_m
            seen = self.env.reset(low + (high - low) * draws.start[within], fresh)
            self.age[fresh] = 0
        act = self._explore(seen, draws, within)
        self.seen, cost, touched = self.env.step(act, None if draws.force is None else draws.force[within])
        ended = touched & mdp.terminate_on_contact
        self.age = np.where(ended, mdp.decisions_per_episode, self.age + 1)
        return pack(seen, act, cost, self.seen, mdp.discount * ~ended, self.age >= mdp.decisions_per_episode)

    def _explore(self, seen: Array, draws: Draws, within: int) -> Array:
        """Uniform actions at first, each held for a while; then the actor's with noise."""
        settings = self.settings
        if self.step < settings.exploratory_steps:
            hold = max(1, round(settings.exploratory_hold_ms / self.mdp.control_period_ms))
            if self.step % hold == 0:
                self.held = draws.uniform_action[within]
            return self.held
        with torch.no_grad():
            batch = torch.from_numpy(seen.astype(np.float32))[:, None, :].to(self.device)
            act = networks.act(self.agent.actor, batch)[:, 0, 0].cpu().numpy()
        noise = settings.exploration_std * draws.exploration[within]
        noisy: Array = np.nan_to_num(act.astype(np.float64)) + noise
        return noisy.clip(-1.0, 1.0)

    def _learn(self, draws: Draws, within: int) -> None:
        """One gradient step of every seed; both learning rates fall linearly from the first one to the last."""
        settings = self.settings
        done = (self.step - settings.exploratory_steps) / (settings.steps - settings.exploratory_steps)
        factor = 1 - (1 - settings.final_learning_rate_fraction) * done
        self.agent.actor_adam.learning_rate = settings.actor_learning_rate * factor
        self.agent.critic_adam.learning_rate = settings.critic_learning_rate * factor
        noise = torch.from_numpy(draws.smoothing[within])[..., None].to(self.device)
        self.agent.update(self.buffer.sample(draws.batch[within], self.step), noise, self.step)

    def actors(self) -> Nets:
        """The actors now, [seeds, ...]."""
        return {name: value[: self.seeds] for name, value in _arrays(self.agent.actor).items()}

    def critics(self) -> Nets:
        """The critics now, [critics, seeds, ...]."""
        return {name: value[:, : self.seeds] for name, value in _arrays(self.agent.critic).items()}

    def responses(self, starts_m: Array) -> Trajectory:
        """Let the actors regulate from all starts [n] for one episode: columns [seeds x n].

        The whole block is let go, padding and all: another batch size would round otherwise, and the unstable plant
        makes other responses of it.
        """
        response = roll_out(_arrays(self.agent.actor), self.plant, self.mdp, starts_m)
        real = np.s_[:, : self.seeds * len(starts_m)]
        states = (response.gap_m, response.velocity_m_s, response.current_a, response.voltage_v)
        return Trajectory(response.time_s, *(values[real] for values in states))

    def new_rows(self) -> NDArray[np.float32]:
        """Rows [n, seeds, WIDTH] that were added since the last call."""
        rows = self.buffer.newest(self.buffer.added - self._told)[:, : self.seeds]
        self._told = self.buffer.added
        return rows

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything but the rows, padding and all."""
        env = {f"env.{name}": value.copy() for name, value in self.env.state._asdict().items()}
        return {
            **{name: value.detach().cpu().numpy().copy() for name, value in self._tensors().items()},
            **env,
            "age": self.age.copy(),
            "held": self.held.copy(),
            "streams": self.streams.state(),
            "step": np.array(self.step),
            "added": np.array(self.buffer.added),
        }

    def restore(self, state: Mapping[str, NDArray[Any]], rows: NDArray[np.float32]) -> None:
        """Go on where `state` was taken; `rows` [n, seeds, WIDTH] are all that were added by then, or the last."""
        with torch.no_grad():
            for name, value in self._tensors().items():
                value.copy_(torch.from_numpy(state[name]))
        self.env.state = State(*(state[f"env.{name}"].copy() for name in State._fields))
        self.age, self.held = state["age"].copy(), state["held"].copy()
        self.streams.restore(state["streams"])
        self._step, self.seen = int(state["step"]), self.env.observe()
        padding = np.repeat(rows[:, -1:], len(self.age) - self.seeds, axis=1)
        self.buffer.restore(np.concatenate([rows, padding], axis=1), int(state["added"]))
        self._told = self.buffer.added

    def _tensors(self) -> dict[str, Tensor]:
        """Every tensor of the agent that training changes, by name."""
        agent = self.agent
        found = {"actor_adam.steps": agent.actor_adam.steps, "critic_adam.steps": agent.critic_adam.steps}
        groups = {
            "actor": agent.actor,
            "critic": agent.critic,
            "slow_actor": agent.slow_actor,
            "slow_critic": agent.slow_critic,
            "actor_adam.mean": agent.actor_adam.mean,
            "actor_adam.square": agent.actor_adam.square,
            "critic_adam.mean": agent.critic_adam.mean,
            "critic_adam.square": agent.critic_adam.square,
        }
        return found | {f"{group}.{name}": value for group, net in groups.items() for name, value in net.items()}


def _arrays(net: Network) -> Nets:
    return {name: value.detach().cpu().numpy().copy() for name, value in net.items()}
