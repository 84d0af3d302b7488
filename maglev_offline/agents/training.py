"""The training loop: a block of seeds of one algorithm and one arm, from empty or prefilled buffers."""

from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from maglev_offline.agents import networks
from maglev_offline.agents.ddpg import Ddpg
from maglev_offline.agents.draws import CHUNK, Draws, DrawStreams
from maglev_offline.agents.evaluation import judge, regulation, roll_out
from maglev_offline.agents.networks import Network
from maglev_offline.agents.settings import Algorithm, EvaluationSettings, TrainingSettings
from maglev_offline.agents.td3 import Td3
from maglev_offline.env import SuspensionBatch
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import Ticker
from maglev_offline.replay.buffer import Batch, ReplayBuffer, pack

Array = NDArray[np.float64]


class Agent(Protocol):
    """What the loop needs of an algorithm."""

    actor: Network
    actor_adam: torch.optim.Adam
    critic_adam: torch.optim.Adam

    def update(self, batch: Batch, noise: torch.Tensor, step: int) -> None:
        """One gradient step."""


class Trained(NamedTuple):
    """What a block of seeds ends with.

    `curves`: one row for a seed and an evaluation. `last` and `best`: the actors, numpy, leading axis [seeds];
    `best` is chosen on the selection starts alone. `regulation`: responses of the last actors from the reference start.
    """

    seeds: list[int]
    curves: pd.DataFrame
    regulation: pd.DataFrame
    last: dict[str, NDArray[np.float32]]
    best: dict[str, NDArray[np.float32]]


def train_block(
    algorithm: Algorithm,
    seeds: list[int],
    plant: Plant,
    mdp: Mdp,
    settings: TrainingSettings,
    evaluation: EvaluationSettings,
    prefill: NDArray[np.float32] | None = None,
    tick: Ticker | None = None,
) -> Trained:
    """Train `seeds` (at most `settings.block`) side by side.

    A short block is padded with repetitions of its last seed, so that the arithmetic of a seed never depends on its
    company. `prefill`: packed rows [n, 9] for the first slots of every buffer. `tick` counts steps of seeds.
    """
    torch.set_num_threads(1)  # small matrices: threads only get into each other's way
    real = len(seeds)
    block = seeds + [seeds[-1]] * (settings.block - real)
    size = len(block)
    agent: Agent = Ddpg(block, settings) if algorithm == "ddpg" else Td3(block, settings)
    prefilled = 0 if prefill is None else len(prefill)
    buffer = ReplayBuffer(size, min(settings.buffer_capacity, prefilled + settings.steps + 1))
    if prefill is not None:
        buffer.prefill(prefill)
    env = SuspensionBatch(plant, mdp, size)
    streams = DrawStreams(block, settings.batch_size, mdp.plant_steps_per_decision, mdp.force_noise_std_n)
    low, high = mdp.start_gap_m
    hold = max(1, round(settings.exploratory_hold_ms / mdp.control_period_ms))

    record = _Record(block[:real], plant, mdp, evaluation)
    record.take(agent.actor, 0)
    age = np.full(size, mdp.decisions_per_episode)
    held = np.zeros(size)
    seen = env.observe()
    for step in range(settings.steps):
        within = step % CHUNK
        if within == 0:
            draws = streams.draw(min(CHUNK, settings.steps - step))
        fresh = age >= mdp.decisions_per_episode
        if fresh.any():
            seen = env.reset(low + (high - low) * draws.start[within], fresh)
            age[fresh] = 0
        if step < settings.exploratory_steps:
            if step % hold == 0:
                held = draws.uniform_action[within]
            act = held
        else:
            act = _explore(agent.actor, seen, settings.exploration_std * draws.exploration[within])
        following, cost, touched = env.step(act, None if draws.force is None else draws.force[within])
        ended = touched & mdp.terminate_on_contact
        buffer.add(pack(seen, act, cost, following, mdp.discount * ~ended))
        seen = following
        age = np.where(ended, mdp.decisions_per_episode, age + 1)
        if step >= settings.exploratory_steps:
            _set_learning_rates(agent, settings, step)
            _learn(agent, buffer, draws, within, step)
        if (step + 1) % evaluation.every_steps == 0 or step + 1 == settings.steps:
            record.take(agent.actor, step + 1)
            if tick is not None:
                tick(real * min(evaluation.every_steps, step + 1 - record.previous_step))
    return record.result()


def _explore(actor: Network, seen: Array, noise: Array) -> Array:
    with torch.no_grad():
        act = networks.act(actor, torch.from_numpy(seen.astype(np.float32))[:, None, :])[:, 0, 0].numpy()
    return np.clip(np.nan_to_num(act.astype(np.float64)) + noise, -1.0, 1.0)


def _learn(agent: Agent, buffer: ReplayBuffer, draws: Draws, within: int, step: int) -> None:
    noise = torch.from_numpy(draws.smoothing[within])[..., None]
    agent.update(buffer.sample(draws.batch[within]), noise, step)


def _set_learning_rates(agent: Agent, settings: TrainingSettings, step: int) -> None:
    """Let both rates fall linearly from the first gradient step to the last."""
    done = (step - settings.exploratory_steps) / (settings.steps - settings.exploratory_steps)
    factor = 1 - (1 - settings.final_learning_rate_fraction) * done
    agent.actor_adam.param_groups[0]["lr"] = settings.actor_learning_rate * factor
    agent.critic_adam.param_groups[0]["lr"] = settings.critic_learning_rate * factor


class _Record:
    """Collects evaluations of a block, and keeps the best actor of each seed."""

    def __init__(self, seeds: list[int], plant: Plant, mdp: Mdp, evaluation: EvaluationSettings) -> None:
        self.seeds, self.plant, self.mdp, self.evaluation = seeds, plant, mdp, evaluation
        self.step = self.previous_step = 0
        self.tables: list[pd.DataFrame] = []
        self.best_cost = np.full(len(seeds), np.inf)
        self.best: dict[str, NDArray[np.float32]] = {}
        self.last: dict[str, NDArray[np.float32]] = {}

    def take(self, actor: Network, step: int) -> None:
        self.previous_step, self.step = self.step, step
        # The whole block is judged, padding and all: another batch size would round otherwise.
        block = {name: value.detach().numpy().copy() for name, value in actor.items()}
        self.response = roll_out(block, self.plant, self.mdp, self.evaluation)
        table = judge(self.response, block, self.plant, self.mdp, self.evaluation).iloc[: len(self.seeds)].copy()
        self.last = {name: value[: len(self.seeds)] for name, value in block.items()}
        table.insert(0, "seed", self.seeds)
        table.insert(1, "env_step", step)
        self.tables.append(table)
        better = table["selection_cost"].to_numpy() < self.best_cost
        self.best_cost = np.where(better, table["selection_cost"], self.best_cost)
        for name, value in self.last.items():
            kept = self.best.get(name, value)
            self.best[name] = np.where(better.reshape(-1, *[1] * (value.ndim - 1)), value, kept)

    def result(self) -> Trained:
        curves = pd.concat(self.tables).sort_values(["seed", "env_step"], ignore_index=True)
        responses = regulation(self.response, self.seeds, self.evaluation)
        return Trained(self.seeds, curves, responses, self.last, self.best)
