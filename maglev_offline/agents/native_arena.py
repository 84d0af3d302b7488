"""The memory that the native kernel works in: a block of floats for each seed, seen here by the names of networks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.agents.engine import Nets
from maglev_offline.agents.native_library import HEAD_REAL, HEAD_WHOLE, HEAD_WORDS, KernelSettings, Layout, NetLayout

CACHE_LINE_BYTES = 64

Part = tuple[int, int, int, int]
"""Where a parameter lies in a network: offset, rows, columns, and floats from one row to the next."""


class Arenas:
    """The arenas of a block of seeds.

    `floats` [seeds, size], each row at a whole cache line. `nets`: views of networks and moments, [seeds, ...] with the
    shapes of `networks.py`, by group (`actor`, `slow_critic`, `critic_adam.mean`, ...); one dictionary for the actor,
    one for each critic. `head`: views of counters and of the magnet's state, [seeds].
    """

    def __init__(self, seeds: int, settings: KernelSettings, layout: Layout) -> None:
        self.floats = aligned((seeds, layout.size), CACHE_LINE_BYTES)
        whole, real = (self.floats[:, 2 * k * HEAD_WORDS : 2 * (k + 1) * HEAD_WORDS] for k in (0, 1))
        self.head: dict[str, NDArray[Any]] = {name: whole.view(np.int64)[:, k] for k, name in enumerate(HEAD_WHOLE)}
        self.head |= {name: real.view(np.float64)[:, k] for k, name in enumerate(HEAD_REAL)}

        batch_norm, layer_norm = bool(settings.batch_norm_actor), bool(settings.layer_norm_critic)
        actor = _parts(layout.actor, settings, biases=not batch_norm, norm=batch_norm)
        critic = _parts(layout.critic, settings, biases=True, norm=layer_norm)
        statistics = _statistics(layout.actor, settings) if batch_norm else {}
        twins = range(settings.critics)
        self.nets: dict[str, list[Nets]] = {
            "actor": [self._views(layout.actor_at, actor | statistics)],
            "slow_actor": [self._views(layout.slow_actor_at, actor | statistics)],
            "actor_adam.mean": [self._views(layout.actor_m, actor)],
            "actor_adam.square": [self._views(layout.actor_v, actor)],
            "critic": [self._views(layout.critic_at[j], critic) for j in twins],
            "slow_critic": [self._views(layout.slow_critic_at[j], critic) for j in twins],
            "critic_adam.mean": [self._views(layout.critic_m[j], critic) for j in twins],
            "critic_adam.square": [self._views(layout.critic_v[j], critic) for j in twins],
        }

    def _views(self, start: int, parts: dict[str, Part]) -> Nets:
        seeds = len(self.floats)
        views = {}
        for name, (offset, rows, columns, stride) in parts.items():
            at = start + offset
            view = self.floats[:, at : at + rows * stride].reshape(seeds, rows, stride)[:, :, :columns]
            views[name] = view.swapaxes(1, 2) if name == "w3" else view
        return views

    def copied(self, group: str) -> Nets:
        """Copies of a group's arrays: [seeds, ...] of an actor, [critics, seeds, ...] of critics."""
        members = self.nets[group]
        if group.removeprefix("slow_").startswith("actor"):
            return {name: np.array(value, order="C") for name, value in members[0].items()}
        return {name: np.stack([member[name] for member in members]) for name in members[0]}

    def put(self, group: str, net: dict[str, NDArray[np.float32]]) -> None:
        """Put arrays as `copied` returns them in their places."""
        of_actor = group.removeprefix("slow_").startswith("actor")
        for index, member in enumerate(self.nets[group]):
            for name, view in member.items():
                view[:] = net[name] if of_actor else net[name][index]


def _parts(net: NetLayout, settings: KernelSettings, *, biases: bool, norm: bool) -> dict[str, Part]:
    """The parameters by name; the last weights lie as a row."""
    one, two = (settings.hidden_1, net.stride_1), (settings.hidden_2, net.stride_2)
    parts = {"w1": (net.w1, 3, *one), "b1": (net.b1, 1, *one)}
    parts |= {"w2": (net.w2, net.inputs_2, *two), "b2": (net.b2, 1, *two)}
    parts |= {"w3": (net.w3, 1, *two), "b3": (net.b3, 1, 1, 1)}
    if not biases:
        del parts["b1"], parts["b2"]
    if norm:
        parts |= {"gain_1": (net.gain_1, 1, *one), "shift_1": (net.shift_1, 1, *one)}
        parts |= {"gain_2": (net.gain_2, 1, *two), "shift_2": (net.shift_2, 1, *two)}
    return parts


def _statistics(net: NetLayout, settings: KernelSettings) -> dict[str, Part]:
    one, two = (settings.hidden_1, net.stride_1), (settings.hidden_2, net.stride_2)
    return {
        "mean_1": (net.mean_1, 1, *one),
        "var_1": (net.var_1, 1, *one),
        "mean_2": (net.mean_2, 1, *two),
        "var_2": (net.var_2, 1, *two),
    }


def aligned(shape: tuple[int, ...], boundary_bytes: int) -> NDArray[np.float32]:
    """Zeros of that shape, whose first lies at a multiple of `boundary_bytes`."""
    size_bytes = 4 * int(np.prod(shape))
    spare = np.zeros(size_bytes + boundary_bytes, dtype=np.uint8)
    offset = -spare.ctypes.data % boundary_bytes
    floats: NDArray[np.float32] = spare[offset : offset + size_bytes].view(np.float32).reshape(shape)
    return floats
