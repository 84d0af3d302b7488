"""A replay buffer for a block of seeds, which may start with logged rows."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from maglev_offline.errors import InputError
from maglev_offline.replay.checks import refuse_not_finite, refuse_small_capacity, refuse_wide_actions
from maglev_offline.replay.sampling import Mixture, places

WIDTH = 10
"""Columns of a packed row: observation 3, action 1, cost 1, next observation 3, discount 1, last 1."""

_ACTION, _COST, _DISCOUNT, _LAST = 3, 4, 8, 9


class Batch(NamedTuple):
    """Transitions with a leading seed axis; every field has the shape [seeds, rows, columns].

    `discount` multiplies the value of the next state: gamma (to the power of the steps that were summed), or 0 where
    the episode has really ended. A time-out is no end, so it bootstraps. `prefilled`: 1 for rows of the prefill, else
    0; None where the buffer holds no prefill.
    """

    observation: Tensor
    action: Tensor
    cost: Tensor
    next_observation: Tensor
    discount: Tensor
    prefilled: Tensor | None = None


def pack(
    observation: NDArray[np.floating],
    action: NDArray[np.floating],
    cost: NDArray[np.floating],
    next_observation: NDArray[np.floating],
    discount: NDArray[np.floating],
    last: NDArray[np.floating] | NDArray[np.bool_],
) -> NDArray[np.float32]:
    """Pack columns into rows [..., WIDTH]; observations are [..., 3], the others [...].

    `last`: the episode was cut or ended after this row, so that no sum of costs runs across it.
    """
    rows = np.empty((*action.shape, WIDTH), dtype=np.float32)
    rows[..., 0:3], rows[..., _ACTION], rows[..., _COST] = observation, action, cost
    rows[..., 5:8], rows[..., _DISCOUNT], rows[..., _LAST] = next_observation, discount, last
    return rows


class ReplayBuffer:
    """A ring of packed transitions for each seed of a block.

    The prefilled rows lie in the first slots, in the order given, each once, and stay: new rows go round in the
    slots behind them. A buffer that evicted the prefill first would silently turn into an empty one.

    Costs of `n_step` rows are summed when a row is sampled, so one buffer serves any n; prefilled rows, which need not
    follow one another, stay one-step rows. `mixture` says how much of a batch comes from the prefill.
    """

    def __init__(
        self, seeds: int, capacity: int, device: str = "cpu", *, n_step: int = 1, mixture: Mixture | None = None
    ) -> None:
        self.rows = torch.zeros((seeds, capacity, WIDTH), dtype=torch.float32, device=device)
        self.capacity, self.n_step, self.mixture = capacity, n_step, mixture or Mixture()
        self.prefilled = 0
        self.added = 0
        self._flat = self.rows.view(-1, WIDTH)
        self._first = capacity * np.arange(seeds)[:, None]

    def prefill(self, rows: NDArray[np.float32]) -> None:
        """Put the rows [n, WIDTH] into slots 0..n-1 of every seed.

        Raises
        ------
        InputError: the buffer is not empty, a row is not finite, an action leaves [-1, 1], or the rows do not leave
            a slot for the agent's own experience.
        """
        if self.prefilled or self.added:
            raise InputError("it already holds rows.", where=WHERE, todo="Prefill it before anything is added.")
        check_prefill(rows, self.capacity)
        self.rows[:, : len(rows)] = torch.from_numpy(rows).to(self.rows.device)
        self.prefilled = len(rows)

    def add(self, rows: NDArray[np.float32]) -> None:
        """Add one row for each seed, [seeds, WIDTH]; the oldest added row goes once the ring is full."""
        slot = self.prefilled + self.added % (self.capacity - self.prefilled)
        self.rows[:, slot] = torch.from_numpy(rows)
        self.added += 1

    def restore(self, rows: NDArray[np.float32], added: int) -> None:
        """Put back the rows that were added last, [n, seeds, WIDTH] in the order of time, `added` in all."""
        room = self.capacity - self.prefilled
        kept = rows[-room:]
        slots = self.prefilled + np.arange(added - len(kept), added) % room
        self.rows[:, torch.from_numpy(slots)] = torch.from_numpy(np.ascontiguousarray(kept.swapaxes(0, 1))).to(
            self.rows.device
        )
        self.added = added

    def newest(self, count: int) -> NDArray[np.float32]:
        """The rows that were added last, [count, seeds, WIDTH], in the order of time; at most as many as are kept."""
        room = self.capacity - self.prefilled
        slots = self.prefilled + np.arange(self.added - min(count, self.added, room), self.added) % room
        found: NDArray[np.float32] = self.rows[:, torch.from_numpy(slots)].transpose(0, 1).contiguous().cpu().numpy()
        return found

    def __len__(self) -> int:
        """Rows that can be sampled, the same for every seed."""
        return min(self.prefilled + self.added, self.capacity)

    def sample(self, uniform: NDArray[np.float64], step: int = 0) -> Batch:
        """Sample with replacement at the draws `uniform` in [0, 1), shape [seeds, batch]; `step` sets the mixture.

        Raises
        ------
        InputError: the buffer is empty.
        """
        if not len(self):
            raise InputError("it is empty.", where=WHERE, todo="Add rows before sampling.")
        slots = places(uniform, self.prefilled, len(self) - self.prefilled, self.mixture, step)
        packed = self._taken(slots)
        cost, following, discount = packed[..., 4:5], packed[..., 5:8], packed[..., 8:9]
        if self.n_step > 1 and self.added > 1:
            cost, following, discount = self._summed(slots, packed)
        prefilled = None
        if self.prefilled:
            prefilled = torch.from_numpy((slots < self.prefilled).astype(np.float32))[..., None].to(self.rows.device)
        return Batch(packed[..., 0:3], packed[..., 3:4], cost, following, discount, prefilled)

    def _taken(self, slots: NDArray[np.int64]) -> Tensor:
        index = torch.from_numpy((slots + self._first).ravel()).to(self.rows.device)
        return self._flat.index_select(0, index).view(*slots.shape, WIDTH)

    def _summed(self, slots: NDArray[np.int64], packed: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Run forward in time from the sampled rows, for at most `n_step` rows and not past the end of an episode.

        c = c_0 + d_0 c_1 + d_0 d_1 c_2 + ..., and the discount is the product of all d that were passed.
        """
        room = self.capacity - self.prefilled
        newest = self.prefilled + (self.added - 1) % room
        cost, following, discount = packed[..., 4:5], packed[..., 5:8], packed[..., 8:9]
        row, slots = packed, slots.copy()
        open_ = torch.from_numpy(slots >= self.prefilled)[..., None].to(self.rows.device)
        for _ in range(self.n_step - 1):
            at_newest = torch.from_numpy(slots == newest)[..., None].to(self.rows.device)
            open_ = open_ & (row[..., 9:10] == 0) & (row[..., 8:9] != 0) & ~at_newest
            if not open_.any():
                break
            slots = np.where(slots < self.prefilled, slots, self.prefilled + (slots - self.prefilled + 1) % room)
            row = self._taken(slots)
            cost = torch.where(open_, cost + discount * row[..., 4:5], cost)
            following = torch.where(open_, row[..., 5:8], following)
            discount = torch.where(open_, discount * row[..., 8:9], discount)
        return cost, following, discount


WHERE = "replay buffer"


def check_prefill(rows: NDArray[np.float32], capacity: int) -> None:
    """Refuse rows that cannot be a prefill of a buffer with `capacity` slots; any engine asks this first.

    Raises
    ------
    InputError: another width, a row that is not finite, an action outside [-1, 1], or no slot left for new rows.
    """
    if rows.ndim != 2 or rows.shape[1] != WIDTH:
        raise InputError(f"prefill has the shape {rows.shape}, expected [n, {WIDTH}].", where=WHERE)
    refuse_small_capacity(len(rows), capacity, WHERE)
    refuse_not_finite({"prefill": rows}, WHERE)
    refuse_wide_actions(rows[:, _ACTION], WHERE)
