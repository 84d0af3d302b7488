"""Actor and critics of the paper (Sec. V), with leading axes: every parameter is stacked over the seeds.

A network is a plain dict of tensors; forward passes are functions. Weights are [..., in, out], biases
[..., 1, out] and activations [..., batch, features], where `...` is [seeds] for the actor and [critics, seeds]
for the critics.
"""

import numpy as np
import torch
from torch import Tensor

Network = dict[str, Tensor]

BATCH_NORM_EPS = LAYER_NORM_EPS = 1e-5
BATCH_NORM_MOMENTUM = 0.1
SATURATED = 3.0
"""An argument of the tanh beyond which the actor is pulled back: the action is within 0.5 % of its limit there."""
STATISTICS = ("mean_1", "var_1", "mean_2", "var_2")
"""Running statistics of the batch norm: moved by averaging, never by a gradient."""


def _linear(rng: np.random.Generator, fan_in: int, fan_out: int, scale: float = 1.0) -> tuple[Tensor, Tensor]:
    """Uniform in +-1/sqrt(fan_in), torch's own default for a linear layer, from a numpy stream."""
    bound = scale / fan_in**0.5
    weight = rng.uniform(-bound, bound, (fan_in, fan_out))
    bias = rng.uniform(-bound, bound, (1, fan_out))
    return torch.tensor(weight, dtype=torch.float32), torch.tensor(bias, dtype=torch.float32)


def init_actor(rng: np.random.Generator, hidden: tuple[int, int], last_layer_scale: float, batch_norm: bool) -> Network:
    """Actor of one seed: 3 -> hidden -> hidden -> 1.

    With batch norm the layers before it have no bias: it would have no gradient, and Adam would turn the rounding
    of that zero into full steps.
    """
    net: Network = {}
    net["w1"], net["b1"] = _linear(rng, 3, hidden[0])
    net["w2"], net["b2"] = _linear(rng, hidden[0], hidden[1])
    net["w3"], net["b3"] = _linear(rng, hidden[1], 1, last_layer_scale)
    if batch_norm:
        for layer, width in enumerate(hidden, start=1):
            del net[f"b{layer}"]
            net[f"gain_{layer}"], net[f"shift_{layer}"] = torch.ones(1, width), torch.zeros(1, width)
            net[f"mean_{layer}"], net[f"var_{layer}"] = torch.zeros(1, width), torch.ones(1, width)
    return net


def init_critic(rng: np.random.Generator, hidden: tuple[int, int], layer_norm: bool = False) -> Network:
    """Critic of one seed: the action enters at the second layer (paper, Sec. V)."""
    net: Network = {}
    net["w1"], net["b1"] = _linear(rng, 3, hidden[0])
    net["w2"], net["b2"] = _linear(rng, hidden[0] + 1, hidden[1])
    net["w3"], net["b3"] = _linear(rng, hidden[1], 1)
    if layer_norm:
        for layer, width in enumerate(hidden, start=1):
            net[f"gain_{layer}"], net[f"shift_{layer}"] = torch.ones(1, width), torch.zeros(1, width)
    return net


def stack(nets: list[Network]) -> Network:
    """Stack the networks of several seeds (or critics) along a new leading axis."""
    return {name: torch.stack([net[name] for net in nets]) for name in nets[0]}


def trained(net: Network, device: str) -> Network:
    """The network on a device, its parameters as leaves that gradients are taken of."""
    return {name: value.to(device).requires_grad_(name not in STATISTICS) for name, value in net.items()}


def member(net: Network, index: int) -> Network:
    """One of the networks along the leading axis, the first critic for instance: the same memory, without gradients."""
    return {name: value.detach()[index] for name, value in net.items()}


def copy(net: Network) -> Network:
    """A detached copy of a network."""
    return {name: value.detach().clone() for name, value in net.items()}


def _normalised(net: Network, layer: int, h: Tensor, training: bool) -> Tensor:
    if training:
        mean, var = h.mean(-2, keepdim=True), h.var(-2, keepdim=True, unbiased=False)
        with torch.no_grad():
            net[f"mean_{layer}"].lerp_(mean, BATCH_NORM_MOMENTUM)
            net[f"var_{layer}"].lerp_(var * h.shape[-2] / max(h.shape[-2] - 1, 1), BATCH_NORM_MOMENTUM)
    else:
        mean, var = net[f"mean_{layer}"], net[f"var_{layer}"]
    return (h - mean) * torch.rsqrt(var + BATCH_NORM_EPS) * net[f"gain_{layer}"] + net[f"shift_{layer}"]


def _hidden(net: Network, layer: int, h: Tensor, training: bool) -> Tensor:
    if f"gain_{layer}" in net:
        return torch.relu_(_normalised(net, layer, torch.matmul(h, net[f"w{layer}"]), training))
    return torch.relu_(torch.matmul(h, net[f"w{layer}"]).add_(net[f"b{layer}"]))


def _output(net: Network, h: Tensor) -> Tensor:
    """The last layer: a sum of products, since a batched product with one column costs as much as one with forty."""
    return (h * net["w3"].transpose(-1, -2)).sum(-1, keepdim=True) + net["b3"]


def argument(net: Network, observation: Tensor, *, training: bool = False) -> Tensor:
    """x with pi(s) = tanh(x): [..., batch, 3] -> [..., batch, 1].

    `training` normalises by the statistics of this batch and moves the running ones (batch norm only).
    """
    h = _hidden(net, 1, observation, training)
    h = _hidden(net, 2, h, training)
    return _output(net, h)


def act(net: Network, observation: Tensor) -> Tensor:
    """pi(s) in [-1, 1]: [..., batch, 3] -> [..., batch, 1]."""
    return torch.tanh(argument(net, observation))


def _layer_normed(net: Network, layer: int, h: Tensor) -> Tensor:
    if f"gain_{layer}" not in net:
        return h
    normed = torch.nn.functional.layer_norm(h, h.shape[-1:], eps=LAYER_NORM_EPS)
    return normed * net[f"gain_{layer}"] + net[f"shift_{layer}"]


def value(net: Network, observation: Tensor, action: Tensor) -> Tensor:
    """h(Q(s, a)) (`roots.py`), to be made small: [..., batch, 3] and [..., batch, 1] -> [..., batch, 1]."""
    h = torch.matmul(observation, net["w1"]).add_(net["b1"])
    h = torch.relu_(_layer_normed(net, 1, h))
    action = action.expand(*h.shape[:-1], 1)
    h = torch.matmul(torch.cat((h, action), dim=-1), net["w2"]).add_(net["b2"])
    return _output(net, torch.relu_(_layer_normed(net, 2, h)))


def track(target: Network, net: Network, rate: float) -> None:
    """theta' <- (1 - tau) theta' + tau theta, for parameters and running statistics alike."""
    with torch.no_grad():
        torch._foreach_lerp_(list(target.values()), list(net.values()), rate)
