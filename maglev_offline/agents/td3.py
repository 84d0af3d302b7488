"""Twin delayed deep deterministic policy gradient: the paper's Algorithm 2, over a block of seeds, on costs.

Each gradient step, with a batch of transitions (s, u, c, s') of every seed:

    u'  = clip(pi'(s') + clip(noise, -0.5, 0.5), -1, 1)   target policy smoothing
    y   = c + gamma max(Q1'(s', u'), Q2'(s', u'))         a cost is minimised: the *larger* twin is the careful one
    phi_j <- Adam on  mean (Qj(s, u) - y)^2, j = 1, 2     both critics
    every d-th step:
        theta <- Adam on  mean  Q1(s, pi(s))              actor goes down the cost
        phi', theta' <- tau phi + (1 - tau) phi', ...     slow copies follow
"""

import torch
from torch import Tensor

from maglev_offline.agents import networks
from maglev_offline.agents.ddpg import adam, descend, initial_networks
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.replay.buffer import Batch


class Td3:
    """State of TD3 for a block of seeds: one actor, two critics, their slow copies, two optimisers."""

    def __init__(self, seeds: list[int], settings: TrainingSettings, device: str = "cpu") -> None:
        self.settings = settings
        self.actor, self.critic = initial_networks(seeds, settings, critics=2, device=device)
        self.slow_actor, self.slow_critic = networks.copy(self.actor), networks.copy(self.critic)
        self.actor_adam = adam(self.actor, settings.actor_learning_rate)
        self.critic_adam = adam(self.critic, settings.critic_learning_rate)

    def update(self, batch: Batch, noise: Tensor, step: int) -> None:
        """One gradient step on a batch [seeds, rows, ...]; `noise`: standard normal draws [seeds, rows, 1]."""
        settings = self.settings
        with torch.no_grad():
            smoothing = (noise * settings.smoothing_std).clamp(-settings.smoothing_clip, settings.smoothing_clip)
            next_action = (networks.act(self.slow_actor, batch.next_observation) + smoothing).clamp(-1.0, 1.0)
            twins = networks.value(self.slow_critic, batch.next_observation, next_action)
            target = batch.cost + batch.discount * twins.amax(dim=0)

        error = networks.value(self.critic, batch.observation, batch.action) - target
        descend(self.critic_adam, error.square().mean(-2).sum())

        if step % settings.policy_delay == 0:
            first = {name: value[0] for name, value in self.critic.items()}
            policy = networks.act(self.actor, batch.observation, training=True)
            descend(self.actor_adam, networks.value(first, batch.observation, policy).mean(-2).sum())
            networks.track(self.slow_critic, self.critic, settings.target_rate)
            networks.track(self.slow_actor, self.actor, settings.target_rate)
