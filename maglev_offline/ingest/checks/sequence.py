"""What the sequence numbers of a topic say: what is missing, and where another recording begins."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import clock
from maglev_offline.ingest.checks.timing import Timing

Index = NDArray[np.int64]


@dataclass(frozen=True)
class Sequence:
    """Gaps in the numbers, g of them, and restarts, r of them; indices are of messages in file order.

    `before` and `after` [g] are the messages around each gap, `missing` [g] how many lie in it. `restarts` [r] are the
    messages at which the numbers begin again.
    """

    before: Index
    after: Index
    missing: Index
    restarts: Index


def read_sequence(numbers: Index, timing: Timing, reorder_ns: int) -> Sequence | None:
    """Look for gaps; None where the numbers do not count the messages (all 0, or shared by several topics).

    `numbers` are those of the timing's messages, in file order.
    """
    steps = np.diff(numbers)
    if len(steps) < 2:
        return None
    ones = np.count_nonzero(steps == 1)
    if ones == len(steps):
        nothing = np.empty(0, dtype=np.int64)
        return Sequence(nothing, nothing, nothing, nothing)
    if 2 * ones <= len(steps):
        return None
    restarts = np.empty(0, dtype=np.int64)
    order = np.arange(len(numbers))
    if steps.min() < 0:
        most_late = 8 + (round(reorder_ns / timing.period_ns) if timing.period_ns else 0)
        epoch = clock.epochs(numbers, most_late)
        restarts = np.flatnonzero(np.diff(epoch)) + 1
        order = np.lexsort((numbers, epoch))
        steps = np.diff(numbers[order])
        steps[restarts - 1] = 0
    gaps = np.flatnonzero(steps > 1)
    return Sequence(order[gaps], order[gaps + 1], steps[gaps] - 1, restarts)


def repeats(numbers: Index, t_ns: Index, values: Iterable[NDArray[np.float64]]) -> Index:
    """Messages with the number, the time and the values of an earlier one, in file order; NaN equals NaN."""
    order = np.lexsort((t_ns, numbers))
    same = (np.diff(numbers[order]) == 0) & (np.diff(t_ns[order]) == 0)
    again, first = order[1:][same], _firsts(order, same)
    equal = np.ones(len(again), dtype=np.bool_)
    for column in values:
        a, b = column[again], column[first]
        equal &= (a == b) | (np.isnan(a) & np.isnan(b))
    return np.sort(again[equal])


def _firsts(order: Index, same: NDArray[np.bool_]) -> Index:
    """For each message that is the same as the one before it in `order`: the first of its group."""
    leader = np.maximum.accumulate(np.where(np.concatenate([[True], ~same]), np.arange(len(order)), 0))
    found: Index = order[leader[1:][same]]
    return found
