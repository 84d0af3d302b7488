"""A replay buffer for a block of seeds, which may start with logged rows."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from maglev_offline.errors import InputError

WIDTH = 9
"""Columns of a packed row: observation 3, action 1, cost 1, next observation 3, discount 1."""


class Batch(NamedTuple):
    """Transitions with a leading seed axis; every field has the shape [seeds, rows, columns].

    `discount` multiplies the value of the next state: gamma, or 0 where the episode has really ended. A time-out is
    no end, so it bootstraps.
    """

    observation: torch.Tensor
    action: torch.Tensor
    cost: torch.Tensor
    next_observation: torch.Tensor
    discount: torch.Tensor


def pack(
    observation: NDArray[np.floating],
    action: NDArray[np.floating],
    cost: NDArray[np.floating],
    next_observation: NDArray[np.floating],
    discount: NDArray[np.floating],
) -> NDArray[np.float32]:
    """Pack columns into rows [..., WIDTH]; observations are [..., 3], the others [...]."""
    return np.concatenate(
        [observation, action[..., None], cost[..., None], next_observation, discount[..., None]], axis=-1
    ).astype(np.float32)


class ReplayBuffer:
    """A ring of packed transitions for each seed of a block.

    The prefilled rows lie in the first slots, in the order given, each once, and stay: new rows go round in the
    slots behind them. A buffer that evicted the prefill first would silently turn into an empty one.
    """

    def __init__(self, seeds: int, capacity: int, device: str = "cpu") -> None:
        self.rows = torch.zeros((seeds, capacity, WIDTH), dtype=torch.float32, device=device)
        self._seed_axis = torch.arange(seeds, device=device)[:, None]
        self.capacity = capacity
        self.prefilled = 0
        self.added = 0

    def prefill(self, rows: NDArray[np.float32]) -> None:
        """Put the rows [n, WIDTH] into slots 0..n-1 of every seed.

        Raises
        ------
        InputError: the buffer is not empty, a row is not finite, an action leaves [-1, 1], or the rows do not leave
            a slot for the agent's own experience.
        """
        where = "replay buffer"
        if self.prefilled or self.added:
            raise InputError("it already holds rows.", where=where, todo="Prefill it before anything is added.")
        if rows.ndim != 2 or rows.shape[1] != WIDTH:
            raise InputError(f"prefill has the shape {rows.shape}, expected [n, {WIDTH}].", where=where)
        if len(rows) >= self.capacity:
            raise InputError(
                f"{len(rows)} prefilled rows do not fit into {self.capacity} slots with room for new ones.",
                where=where,
                todo="Raise training.buffer_capacity or lower curate.target_rows.",
            )
        bad = ~np.isfinite(rows).all(axis=1)
        if bad.any():
            raise InputError(f"{bad.sum()} prefilled rows are not finite, first row {bad.argmax()}.", where=where)
        outside = np.abs(rows[:, 3]) > 1
        if outside.any():
            raise InputError(
                f"{outside.sum()} prefilled actions lie outside [-1, 1], first row {outside.argmax()}.",
                where=where,
                todo="Scale actions by the voltage limit of the recipe.",
            )
        self.rows[:, : len(rows)] = torch.from_numpy(rows).to(self.rows.device)
        self.prefilled = len(rows)

    def add(self, rows: NDArray[np.float32]) -> None:
        """Add one row for each seed, [seeds, WIDTH]; the oldest added row goes once the ring is full."""
        slot = self.prefilled + self.added % (self.capacity - self.prefilled)
        self.rows[:, slot] = torch.from_numpy(rows).to(self.rows.device)
        self.added += 1

    def __len__(self) -> int:
        """Rows that can be sampled, the same for every seed."""
        return min(self.prefilled + self.added, self.capacity)

    def sample(self, uniform: NDArray[np.float64]) -> Batch:
        """Sample with replacement at the draws `uniform` in [0, 1), shape [seeds, batch].

        Raises
        ------
        InputError: the buffer is empty.
        """
        if not len(self):
            raise InputError("it is empty.", where="replay buffer", todo="Add rows before sampling.")
        slots = torch.from_numpy((uniform * len(self)).astype(np.int64)).to(self.rows.device)
        packed = self.rows[self._seed_axis, slots]
        return Batch(packed[..., 0:3], packed[..., 3:4], packed[..., 4:5], packed[..., 5:8], packed[..., 8:9])
