"""Where the grid instants of a point lie among the messages of one topic: found once, used by all its signals."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.grid import ON_GRID_NS, Grid, Times

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


class Bounds(NamedTuple):
    """The messages that each of m stretches may draw on: `first` to `stop` of the topic, all of epoch `epoch`."""

    first: Index
    stop: Index
    epoch: Index


@dataclass(frozen=True)
class Place:
    """The rows of a grid among the messages at `t_ns` [n]; all row arrays have shape [rows] unless said otherwise.

    `first` and `stop` bound the messages of each row, shape [rows] or [1]; a row without any has `stop` = `first`.
    Of them `after` is the earliest at or after the instant and `before` the one before that; at the ends of the
    bounds both are the last message or the first; `t_before` and `t_after` are their times. `hit` says that the
    message `nearest` lies on the instant. `longest_ns`: two messages further apart, or one that is longer ago, say
    nothing about an instant.
    """

    t_ns: Times
    grid: Grid
    bounds: Bounds
    first: Index
    stop: Index
    before: Index
    after: Index
    t_before: Times
    t_after: Times
    nearest: Index
    hit: Mask
    longest_ns: int | None = None
    _latest: dict[int, tuple[Index, Mask | None]] = field(default_factory=dict)

    @cached_property
    def all_hit(self) -> bool:
        """Whether all rows were measured."""
        return bool(self.hit.all())

    @cached_property
    def hits(self) -> NDArray[np.intp]:
        """The rows that were measured."""
        return np.flatnonzero(self.hit)

    @cached_property
    def not_hit(self) -> Mask:
        """The rows that were not measured."""
        return ~self.hit

    @cached_property
    def weight(self) -> NDArray[np.float64]:
        """The share of `after` in a straight line at the instant, from 0 to 1."""
        # Differences of times fit into a float64 to the nanosecond; absolute times do not.
        share: NDArray[np.float64] = (self.grid.t_ns - self.t_before) / np.maximum(self.t_after - self.t_before, 1)
        return share

    @cached_property
    def outside(self) -> Mask | None:
        """Rows that do not lie between two messages near enough to each other; None: there is no such row."""
        lost = (self.t_before > self.grid.t_ns) | (self.t_after < self.grid.t_ns)
        if self.longest_ns is not None:
            lost |= self.t_after - self.t_before > self.longest_ns
        lost &= self.not_hit
        return lost if lost.any() else None

    def latest(self, tolerance_ns: int) -> tuple[Index, Mask | None]:
        """The latest message up to `tolerance_ns` behind each instant, and the rows without one that counts."""
        if tolerance_ns not in self._latest:
            self._latest[tolerance_ns] = self._find_latest(tolerance_ns)
        return self._latest[tolerance_ns]

    def _find_latest(self, tolerance_ns: int) -> tuple[Index, Mask | None]:
        t, until = self.t_ns, self.grid.t_ns + tolerance_ns
        latest = np.where(self.t_after <= until, self.after, self.before)
        following = np.minimum(latest + 1, self.stop - 1)
        if ((t[following] <= until) & (following > latest)).any():
            latest = np.clip(rank(t, until, self.grid.begin, self.bounds, "right") - 1, self.first, self.stop - 1)
        lost = (t[latest] > until) | (self.stop <= self.first)
        if self.longest_ns is not None:
            lost |= self.grid.t_ns - t[latest] > self.longest_ns
        lost &= self.not_hit
        return np.where(self.hit, self.nearest, latest), lost if lost.any() else None


def place(t_ns: Times, grid: Grid, bounds: Bounds, longest_ns: int | None = None) -> Place:
    """Find the rows of a grid among the messages of a topic (at least one), those of stretch k within its bounds."""
    first, stop = grid.spread(bounds.first), grid.spread(bounds.stop)
    here = grid.t_ns
    last = np.maximum(np.minimum(stop, len(t_ns)) - 1, 0)
    counted = len(first) == 1 and 0 < stop[0] - first[0] < _COUNT_BELOW * len(here)
    ranks = _count(t_ns, grid, bounds) if counted else rank(t_ns, here, grid.begin, bounds, "left")
    after = np.clip(ranks, np.minimum(first, last), last)
    before = np.maximum(after - 1, np.minimum(first, last))
    t_before, t_after = t_ns.take(before, mode="clip"), t_ns.take(after, mode="clip")
    behind, ahead = np.abs(here - t_before), np.abs(t_after - here)
    nearest = np.where(behind < ahead, before, after)
    hit = np.minimum(behind, ahead) <= ON_GRID_NS
    if (bounds.stop <= bounds.first).any():
        hit &= stop > first
    return Place(t_ns, grid, bounds, first, stop, before, after, t_before, t_after, nearest, hit, longest_ns)


def rank(t_ns: Times, at_ns: Times, begin: NDArray[np.int64], bounds: Bounds, side: Literal["left", "right"]) -> Index:
    """How many messages come before each time (`right`: or at it), shape [rows]; rows `begin[k]` to `begin[k + 1]`
    are those of stretch k. The number is that of the whole topic, and may be beyond the bounds of the stretch.

    Messages ascend in time within an epoch only, so all stretches of one epoch are looked up together.
    """
    found = np.zeros(len(at_ns), dtype=np.int64)
    some = np.flatnonzero((np.diff(begin) > 0) & (bounds.stop > bounds.first))
    epoch = bounds.epoch[some]
    for group in np.split(some, np.flatnonzero(epoch[1:] != epoch[:-1]) + 1) if len(some) else ():
        rows = slice(int(begin[group[0]]), int(begin[group[-1] + 1]))
        low, high = int(bounds.first[group].min()), int(bounds.stop[group].max())
        found[rows] = np.searchsorted(t_ns[low:high], at_ns[rows], side=side) + low
    return found


_COUNT_BELOW = 4
"""Up to so many messages for a row, counting them by their step on the grid is quicker than looking the rows up."""


def _count(t_ns: Times, grid: Grid, bounds: Bounds) -> Index:
    """As `rank` of all instants to the left, for one stretch: its instants are uniform."""
    low, high = int(bounds.first[0]), int(bounds.stop[0])
    step = (t_ns[low:high] - grid.t_ns[0]) // grid.period_ns + 1
    found: Index = np.cumsum(np.bincount(np.clip(step, 0, len(grid.t_ns)), minlength=len(grid.t_ns)))
    return found[: len(grid.t_ns)] + low


def bracket(
    t_ns: Times, start_ns: Times, end_ns: Times, bounds: Bounds, *, reach_ns: int = 0, longest_ns: int | None = None
) -> Mask:
    """Messages that the spans from `start_ns` to `end_ns` [m] draw on, shape [n].

    For each span, from the latest at or before it to the earliest at or after it, and `reach_ns` more on both sides,
    within the bounds and, of those outside the span, at most `longest_ns` away from it.
    """
    if len(start_ns) == 0 or len(t_ns) == 0:
        return np.zeros(len(t_ns), dtype=np.bool_)
    each = np.arange(len(start_ns) + 1)
    low = rank(t_ns, start_ns - reach_ns, each, bounds, "right") - 1
    high = rank(t_ns, end_ns + reach_ns, each, bounds, "left") + 1
    if longest_ns is not None:
        low = np.maximum(low, rank(t_ns, start_ns - longest_ns, each, bounds, "left"))
        high = np.minimum(high, rank(t_ns, end_ns + longest_ns, each, bounds, "right"))
    low, high = np.maximum(low, bounds.first), np.minimum(high, bounds.stop)
    some = high > low
    change = np.bincount(low[some], minlength=len(t_ns) + 1) - np.bincount(high[some], minlength=len(t_ns) + 1)
    covered: Mask = np.cumsum(change[:-1]) > 0
    return covered
