"""Deep deterministic policy gradient (Lillicrap et al., 2016; the paper's Algorithm 1), on costs.

Each gradient step, with a batch of transitions (s, u, c, s', d) of every seed, where d is the discount:

    y      =  h(c + d h^-1(Z'(s', pi'(s'))))                     (1)  target, from the slow copies
    phi   <-  Adam down  mean (Z(s, u) - y)^2                    (2)  critic
    theta <-  Adam down  mean Z(s, pi(s))                        (3)  actor: down the cost
    phi'  <-  tau phi + (1 - tau) phi',  theta' likewise         (4)  slow copies follow

The critic is Z = h(Q), the root of the cost-to-go (`roots.py`); in the paper h is the identity, and Z is Q.
Losses are summed over the seeds: no seed's gradient touches another seed's parameters.
"""

import torch
from torch import Tensor

from maglev_offline.agents import networks
from maglev_offline.agents.adam import Adam
from maglev_offline.agents.networks import Network
from maglev_offline.agents.roots import from_root, to_root
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
            target = bootstrap(batch, slow_value, self.settings)  # (1)

        error = networks.value(self.critic, batch.observation, batch.action) - target
        self.critic_adam.descend(error.square().mean(-2).sum())  # (2)

        loss = actor_loss(self.actor, networks.member(self.critic, 0), batch, self.settings)
        self.actor_adam.descend(loss)  # (3)

        networks.track(self.slow_critic, self.critic, self.settings.target_rate)  # (4)
        networks.track(self.slow_actor, self.actor, self.settings.target_rate)


def bootstrap(batch: Batch, slow_value: Tensor, settings: TrainingSettings) -> Tensor:
    """h(c + d h^-1(Z')): the targets of a batch, from what the slow critics say of its next states."""
    offset = settings.critic_root_offset
    return to_root(batch.cost + batch.discount * from_root(slow_value, offset), offset)


def actor_loss(actor: Network, critic: Network, batch: Batch, settings: TrainingSettings) -> Tensor:
    """What the actor goes down, summed over the seeds: mean Z(s, pi(s)), and two pulls if asked for.

    Where pi = tanh(x) saturates it has no gradient, and a policy that did so everywhere would stay so: beyond |x| = 3
    the actor is pulled back, after the penalty on all of x of Andrychowicz et al. (2017):

        + v mean max(|x| - 3, 0)^2                                       v: `saturation_weight`

    To logged actions, after TD3+BC (Fujimoto & Gu, 2021, eqs. 3 and 5), where the sum runs over prefilled rows alone:

        mean Z(s, pi(s)) / mean |Z(s, pi(s))|  +  w / rows  sum (pi(s) - u)^2    w: `cloning_weight`
    """
    x = networks.argument(actor, batch.observation, training=True)
    policy = torch.tanh(x)
    value = networks.value(critic, batch.observation, policy)
    saturation = settings.saturation_weight * (x.abs() - networks.SATURATED).relu().square().mean(-2)
    if not settings.cloning_weight:
        return (value.mean(-2) + saturation).sum()
    scaled = value.mean(-2) / value.detach().abs().mean(-2)
    if batch.prefilled is None:
        return (scaled + saturation).sum()
    away = (batch.prefilled * (policy - batch.action).square()).mean(-2)
    return (scaled + settings.cloning_weight * away + saturation).sum()


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
