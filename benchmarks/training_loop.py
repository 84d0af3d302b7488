"""A peer of `training_peers.py`: DDPG and TD3 as one plain loop in torch, one environment, one seed.

Written from how CleanRL describes its single-file implementations: modules of torch.nn, torch.optim.Adam, a buffer in
numpy, one gradient step for each step of the environment, slow copies that follow parameter by parameter. It leaves out
what CleanRL does besides (episode statistics, logging, a vector environment of one), which favours it.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

HIDDEN, BATCH, BUFFER_ROWS = 40, 100, 1_000_000
DISCOUNT, TRACKING, EXPLORATION_STD = 0.9, 0.005, 0.2
ACTOR_RATE, CRITIC_RATE = 5e-4, 1e-3


def perceptron(inputs: int, *last: nn.Module) -> nn.Sequential:
    """Two hidden layers, one output."""
    return nn.Sequential(
        nn.Linear(inputs, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, 1), *last
    )


class Buffer:
    """A ring of transitions in numpy."""

    def __init__(self, observation_size: int) -> None:
        self.columns = {
            "seen": np.zeros((BUFFER_ROWS, observation_size), np.float32),
            "action": np.zeros((BUFFER_ROWS, 1), np.float32),
            "reward": np.zeros((BUFFER_ROWS, 1), np.float32),
            "next_seen": np.zeros((BUFFER_ROWS, observation_size), np.float32),
            "ended": np.zeros((BUFFER_ROWS, 1), np.float32),
        }
        self.added = 0

    def add(self, **row: Any) -> None:
        """Add a transition in the place of the oldest."""
        for name, value in row.items():
            self.columns[name][self.added % BUFFER_ROWS] = value
        self.added += 1

    def sample(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw a batch."""
        rows = rng.integers(0, min(self.added, BUFFER_ROWS), BATCH)
        return {name: torch.from_numpy(column[rows]) for name, column in self.columns.items()}


class Loop:
    """The whole algorithm; `twin` makes it TD3."""

    def __init__(self, env: Any, twin: bool) -> None:
        self.env, self.twin, self.delay = env, twin, 2 if twin else 1
        self.rng = np.random.default_rng(0)
        torch.manual_seed(0)
        inputs = env.observation_space.shape[0]
        self.actor, self.slow_actor = (perceptron(inputs, nn.Tanh()) for _ in range(2))
        self.critics, self.slow_critics = (
            nn.ModuleList(perceptron(inputs + 1) for _ in range(2 if twin else 1)) for _ in range(2)
        )
        self.slow_actor.load_state_dict(self.actor.state_dict())
        self.slow_critics.load_state_dict(self.critics.state_dict())
        self.actor_adam = torch.optim.Adam(self.actor.parameters(), lr=ACTOR_RATE)
        self.critic_adam = torch.optim.Adam(self.critics.parameters(), lr=CRITIC_RATE)
        self.buffer, self.updates = Buffer(inputs), 0
        self.seen, _ = env.reset(seed=0)

    def run(self, steps: int) -> None:
        """Make so many steps, and a gradient step after each once there is a batch."""
        for _ in range(steps):
            with torch.no_grad():
                action = self.actor(torch.from_numpy(self.seen)[None])[0].numpy()
            action = np.clip(action + self.rng.normal(0, EXPLORATION_STD, 1), -1, 1).astype(np.float32)
            next_seen, reward, ended, cut, _ = self.env.step(action)
            self.buffer.add(seen=self.seen, action=action, reward=reward, next_seen=next_seen, ended=ended)
            self.seen = self.env.reset()[0] if ended or cut else next_seen
            if self.buffer.added > BATCH:
                self.update(self.buffer.sample(self.rng))

    def update(self, batch: dict[str, Tensor]) -> None:
        """One gradient step."""
        with torch.no_grad():
            next_action = self.slow_actor(batch["next_seen"])
            if self.twin:
                smoothing = (torch.randn_like(next_action) * 0.1).clamp(-0.5, 0.5)
                next_action = (next_action + smoothing).clamp(-1, 1)
            both = torch.cat([batch["next_seen"], next_action], 1)
            value = torch.stack([critic(both) for critic in self.slow_critics]).amin(0)
            target = batch["reward"] + DISCOUNT * (1 - batch["ended"]) * value
        both = torch.cat([batch["seen"], batch["action"]], 1)
        loss = sum(nn.functional.mse_loss(critic(both), target) for critic in self.critics)
        self.critic_adam.zero_grad()
        loss.backward()
        self.critic_adam.step()
        self.updates += 1
        if self.updates % self.delay == 0:
            self.update_actor(batch["seen"])

    def update_actor(self, seen: Tensor) -> None:
        """One gradient step of the actor; the slow copies follow."""
        loss = -self.critics[0](torch.cat([seen, self.actor(seen)], 1)).mean()
        self.actor_adam.zero_grad()
        loss.backward()
        self.actor_adam.step()
        for net, slow in ((self.actor, self.slow_actor), (self.critics, self.slow_critics)):
            for parameter, follower in zip(net.parameters(), slow.parameters(), strict=True):
                follower.data.copy_(TRACKING * parameter.data + (1 - TRACKING) * follower.data)
