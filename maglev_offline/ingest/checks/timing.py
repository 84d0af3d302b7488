"""The times of one topic's messages, in file order and in time order, computed once for all checks of them."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import clock
from maglev_offline.ingest.findings import MOST_PLACES, Place
from maglev_offline.ingest.median import median
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.columns import ChannelColumns
from maglev_offline.logs.signals import Clock

Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

FARTHEST_NS = 2**62
"""Differences of times within this of 1970 (to the year 2116) fit into an int64; a log may claim any others."""


@dataclass(frozen=True)
class Timing:
    """Messages that have a time to count with, n of them. All arrays but `steps_ns` have shape [n].

    `t_ns`, `message` (the place within the topic), `epoch` and `row` (the place in the columns) are in file order,
    `order` sorts by epoch and time. `steps_ns` [n-1] are the steps in that order; one across a reset is 0. `period_ns`
    is the median of the steps above 0, or 0 where there is none. `resets` are places in file order that begin an epoch.
    """

    t_ns: Index
    message: Index
    row: Index
    epoch: NDArray[np.int32]
    order: NDArray[np.intp]
    in_order: bool
    steps_ns: Index
    period_ns: float
    resets: Index

    def __len__(self) -> int:
        return len(self.t_ns)

    def place(self, first: int, last: int) -> Place:
        """A stretch from one message to another, both numbered in file order."""
        return Place(int(self.t_ns[first]), int(self.t_ns[last]), int(self.message[first]), int(self.message[last]))

    def places(self, firsts: Iterable[int], lasts: Iterable[int]) -> list[Place]:
        """The first `MOST_PLACES` stretches."""
        found: list[Place] = []
        for first, last in zip(firsts, lasts, strict=True):
            if len(found) == MOST_PLACES:
                break
            found.append(self.place(first, last))
        return found


def timing(columns: ChannelColumns, used: Clock, settings: IngestSettings, message: Index | None = None) -> Timing:
    """Order the messages by the clock in use; `message` numbers them within the topic (default: from 0)."""
    times = clock.choose(columns, used)
    number = np.arange(len(times)) if message is None else message
    row = np.arange(len(times))
    # NO_TIME is one of those that cannot be counted with: two passes in the usual case.
    if not countable(times):
        row = np.flatnonzero((times > -FARTHEST_NS) & (times < FARTHEST_NS))
        times, number = times[row], number[row]
    steps = np.diff(times)
    in_order = len(steps) == 0 or int(steps.min()) >= 0
    order = np.arange(len(times))
    if in_order:
        epoch = np.zeros(len(times), dtype=np.int32)
        resets = np.empty(0, dtype=np.int64)
    else:
        epoch = clock.epochs(times, round(settings.reorder_ms * clock.NS_PER_MS))
        resets = np.flatnonzero(np.diff(epoch)) + 1
        # By time within each epoch; the sort is quick since little is out of place.
        bounds = [0, *resets.tolist(), len(times)]
        order = np.concatenate([a + np.argsort(times[a:b], kind="stable") for a, b in pairwise(bounds)])
        steps = np.diff(times[order])
        steps[resets - 1] = 0
    return Timing(times, number, row, epoch, order, in_order, steps, period_of(steps), resets)


def countable(t_ns: Index) -> bool:
    """Whether every time is there and lies within `FARTHEST_NS`."""
    return len(t_ns) == 0 or (int(t_ns.min()) > -FARTHEST_NS and int(t_ns.max()) < FARTHEST_NS)


def period_of(steps_ns: Index) -> float:
    """Median of the steps above 0, ns; of every k-th where there are many, and 0 where there are none."""
    some = steps_ns[:: max(len(steps_ns) // 2048, 1)]
    some = some[some > 0]
    return median(some) if len(some) else 0.0


def runs(mask: Mask) -> tuple[Index, Index]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return edges[::2], edges[1::2] - 1
