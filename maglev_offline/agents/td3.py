"""Twin delayed deep deterministic policy gradient (Fujimoto et al., 2018; the paper's Algorithm 2), on costs.

Each gradient step, with a batch of transitions (s, u, c, s', d) of every seed, where d is the discount:

    u'       =  clip(pi'(s') + clip(noise, -b, b), -1, 1)        (1)  target policy smoothing
    y        =  h(c + d h^-1(max(Z1'(s', u'), Z2'(s', u'))))     (2)  costs: the *larger* twin is the careful one
    phi_j   <-  Adam down  mean (Zj(s, u) - y)^2,  j = 1, 2      (3)  both critics
    every k-th step:
      theta <-  Adam down  mean Z1(s, pi(s))                     (4)  actor: down the cost
      phi'  <-  tau phi + (1 - tau) phi',  theta' likewise       (5)  slow copies follow

The critics are Z = h(Q), the roots of the cost-to-go (`roots.py`); in the paper h is the identity, and Z is Q.
"""

import torch
from torch import Tensor

from maglev_offline.agents import networks
from maglev_offline.agents.adam import Adam
from maglev_offline.agents.ddpg import actor_loss, bootstrap, initial_networks
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.replay.buffer import Batch


class Td3:
    """State of TD3 for a block of seeds: one actor, two critics, their slow copies, two optimisers."""

    def __init__(self, seeds: list[int], settings: TrainingSettings, device: str = "cpu") -> None:
        self.settings = settings
        self.actor, self.critic = initial_networks(seeds, settings, critics=2, device=device)
        self.slow_actor, self.slow_critic = networks.copy(self.actor), networks.copy(self.critic)
        self.actor_adam = Adam(self.actor, settings.actor_learning_rate)
        self.critic_adam = Adam(self.critic, settings.critic_learning_rate)

    def update(self, batch: Batch, noise: Tensor, step: int) -> None:
        """One gradient step on a batch [seeds, rows, ...]; `noise`: standard normal draws [seeds, rows, 1]."""
        settings = self.settings
        with torch.no_grad():
            smoothing = (noise * settings.smoothing_std).clamp(-settings.smoothing_clip, settings.smoothing_clip)
            next_action = (networks.act(self.slow_actor, batch.next_observation) + smoothing).clamp(-1.0, 1.0)  # (1)
            twins = networks.value(self.slow_critic, batch.next_observation, next_action)
            target = bootstrap(batch, torch.maximum(twins[0], twins[1]), settings)  # (2)

        error = networks.value(self.critic, batch.observation, batch.action) - target
        self.critic_adam.descend(error.square().mean(-2).sum())  # (3)

        if step % settings.policy_delay == 0:
            loss = actor_loss(self.actor, networks.member(self.critic, 0), batch, settings)
            self.actor_adam.descend(loss)  # (4)
            networks.track(self.slow_critic, self.critic, settings.target_rate)  # (5)
            networks.track(self.slow_actor, self.actor, settings.target_rate)
