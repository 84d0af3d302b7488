"""Deep deterministic policy gradient: the paper's Algorithm 1, over a block of seeds, on costs.

Each gradient step, with a batch of transitions (s, u, c, s') of every seed:

    y   = c + gamma Q'(s', pi'(s'))                       target, from the slow copies
    phi   <- Adam on  mean (Q(s, u) - y)^2                critic
    theta <- Adam on  mean  Q(s, pi(s))                   actor goes down the cost
    phi', theta' <- tau phi + (1 - tau) phi', ...         slow copies follow

Losses are summed over the seeds: no seed's gradient touches another seed's parameters.
"""

import torch
from torch import Tensor

from maglev_offline.agents import networks
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
        self.actor_adam = adam(self.actor, settings.actor_learning_rate)
        self.critic_adam = adam(self.critic, settings.critic_learning_rate)

    def update(self, batch: Batch, noise: Tensor, step: int) -> None:  # noqa: ARG002
        """One gradient step on a batch [seeds, rows, ...]; `noise` and `step` are not used by DDPG."""
        with torch.no_grad():
            next_action = networks.act(self.slow_actor, batch.next_observation)
            slow_value = networks.value(self.slow_critic, batch.next_observation, next_action)
            target = batch.cost + batch.discount * slow_value

        error = networks.value(self.critic, batch.observation, batch.action) - target
        descend(self.critic_adam, error.square().mean(-2).sum())

        policy = networks.act(self.actor, batch.observation, training=True)
        descend(self.actor_adam, networks.value(self.critic, batch.observation, policy).mean(-2).sum())

        networks.track(self.slow_critic, self.critic, self.settings.target_rate)
        networks.track(self.slow_actor, self.actor, self.settings.target_rate)


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
        networks.stack([networks.init_critic(stream(seed, f"critic {k} weights"), settings.hidden) for seed in seeds])
        for k in range(critics)
    ]
    return _on(networks.stack(actors), device), _on(networks.stack(twins), device)


def _on(net: Network, device: str) -> Network:
    return {name: value.to(device).requires_grad_(name not in networks.STATISTICS) for name, value in net.items()}


def adam(net: Network, learning_rate: float) -> torch.optim.Adam:
    """The optimiser of one network of all seeds; Adam works by element, so the seeds stay apart."""
    return torch.optim.Adam(networks.trainable(net), lr=learning_rate, fused=True)


def descend(optimiser: torch.optim.Adam, loss: Tensor) -> None:
    """One step down the loss in the parameters of this optimiser, and of no other."""
    parameters = optimiser.param_groups[0]["params"]
    for parameter, gradient in zip(parameters, torch.autograd.grad(loss, parameters), strict=True):
        parameter.grad = gradient
    optimiser.step()
