"""Deep deterministic policy gradient (Lillicrap et al., 2016; the paper's Algorithm 1), on costs.

Each gradient step, with a batch of transitions (s, u, c, s', d) of every seed, where d is the discount:

    y      =  c + d Q'(s', pi'(s'))                              (1)  target, from the slow copies
    phi   <-  Adam down  mean (Q(s, u) - y)^2                    (2)  critic
    theta <-  Adam down  mean Q(s, pi(s))                        (3)  actor: down the cost
    phi'  <-  tau phi + (1 - tau) phi',  theta' likewise         (4)  slow copies follow

Losses are summed over the seeds: no seed's gradient touches another seed's parameters.
"""

import torch
from torch import Tensor

from maglev_offline.agents import networks
from maglev_offline.agents.adam import Adam
from maglev_offline.agents.networks import Network
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.replay.buffer import Batch
from maglev_offline.streams import stream


class Ddpg:
    """State of DDPG for a block of seeds: one actor, one critic, their slow copies, two optimisers."""

    def __init__(self, seeds: list[int], settings: TrainingSettings, device: str = "cpu") -> None:
        self.settings = settings
        self.actor, self.critic = initial_networks(seeds, settings, critics=1, device=device)
        self.slow_actor, self.slow_critic = networks.copy(self.actor), networks.copy(self.critic)
        self.actor_adam = Adam(self.actor, settings.actor_learning_rate)
        self.critic_adam = Adam(self.critic, settings.critic_learning_rate)

    def update(self, batch: Batch, noise: Tensor, step: int) -> None:  # noqa: ARG002
        """One gradient step on a batch [seeds, rows, ...]; `noise` and `step` are not used by DDPG."""
        with torch.no_grad():
            next_action = networks.act(self.slow_actor, batch.next_observation)
            slow_value = networks.value(self.slow_critic, batch.next_observation, next_action)
            target = batch.cost + batch.discount * slow_value  # (1)

        error = networks.value(self.critic, batch.observation, batch.action) - target
        self.critic_adam.descend(error.square().mean(-2).sum())  # (2)

        loss = actor_loss(self.actor, networks.member(self.critic, 0), batch, self.settings.cloning_weight)
        self.actor_adam.descend(loss)  # (3)

        networks.track(self.slow_critic, self.critic, self.settings.target_rate)  # (4)
        networks.track(self.slow_actor, self.actor, self.settings.target_rate)


def actor_loss(actor: Network, critic: Network, batch: Batch, cloning_weight: float) -> Tensor:
    """What the actor goes down, summed over the seeds: mean Q(s, pi(s)), and a pull to logged actions if asked for.

    With a weight w > 0, after TD3+BC (Fujimoto & Gu, 2021, eqs. 3 and 5), where the sum runs over prefilled rows alone:

        mean Q(s, pi(s)) / mean |Q(s, pi(s))|  +  w / rows  sum (pi(s) - u)^2
    """
    policy = networks.act(actor, batch.observation, training=True)
    cost_to_go = networks.value(critic, batch.observation, policy)
    if not cloning_weight:
        return cost_to_go.mean(-2).sum()
    scaled = cost_to_go.mean(-2) / cost_to_go.detach().abs().mean(-2)
    if batch.prefilled is None:
        return scaled.sum()
    away = (batch.prefilled * (policy - batch.action).square()).mean(-2)
    return (scaled + cloning_weight * away).sum()


def initial_networks(
    seeds: list[int], settings: TrainingSettings, *, critics: int, device: str
) -> tuple[Network, Network]:
    """Actor [seeds, ...] and critics [critics, seeds, ...], each network from a stream of its own seed."""
    actors = [
        networks.init_actor(
            stream(seed, "actor weights"),
            settings.hidden,
            settings.actor_last_layer_scale,
            settings.batch_norm_actor,
        )
        for seed in seeds
    ]
    twins = [
        networks.stack(
            [
                networks.init_critic(stream(seed, f"critic {k} weights"), settings.hidden, settings.layer_norm_critic)
                for seed in seeds
            ]
        )
        for k in range(critics)
    ]
    return networks.trained(networks.stack(actors), device), networks.trained(networks.stack(twins), device)
