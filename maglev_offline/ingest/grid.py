"""The grid: uniform instants in integer nanoseconds, in the phase of the messages.

Between samples of 100 ms the gap turns by up to 3 rad, so a row in the middle between two messages would be an
invention (docs/decisions/0007).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ON_GRID_NS = 1000
"""A message within a microsecond of a grid instant was measured there."""

Times = NDArray[np.int64]


@dataclass(frozen=True)
class Grid:
    """Grid instants of m stretches, one stretch after the other.

    `t_ns` has shape [rows]; the rows of stretch k are `begin[k]` to `begin[k + 1]`, so that `begin` has shape [m + 1].
    """

    t_ns: Times
    begin: NDArray[np.int64]
    period_ns: int

    @property
    def rows(self) -> NDArray[np.int64]:
        """How many rows each stretch has, shape [m]."""
        return np.diff(self.begin)

    def spread(self, of_stretch: NDArray[np.int64]) -> NDArray[np.int64]:
        """A number of each stretch for each of its rows, shape [rows]; shape [1] where there is one stretch."""
        return of_stretch if len(of_stretch) == 1 else np.repeat(of_stretch, self.rows)


def phases(t_ns: Times, first: NDArray[np.int64], stop: NDArray[np.int64], period_ns: int) -> Times:
    """Phase in [0, period_ns) that most messages of a stretch keep to within a tenth of the period, shape [m].

    Stretch k is the messages `first[k]` to `stop[k]`, and the stretches follow each other without a gap. It is the
    phase of the middle one of the messages; those that lie on a grid already give it exactly. Where they keep to
    none, as a source that is faster than the grid, it is the phase of the first message.
    """
    if len(first) == 0:
        return np.empty(0, dtype=np.int64)
    t_ns = t_ns[first[0] : stop[-1]]
    start = t_ns[first - first[0]]
    middle, together = _middle(t_ns, start, stop - first, period_ns)
    if not together.all():
        # Messages about half a period from the first fall on both ends of the range of offsets; from there they do not.
        other, is_other = _middle(t_ns, start + period_ns // 2, stop - first, period_ns)
        middle = np.where(together, middle, np.where(is_other, other + period_ns // 2, 0))
    phase: Times = (start % period_ns + middle) % period_ns
    return phase


def _middle(
    t_ns: Times, reference: Times, lengths: NDArray[np.int64], period_ns: int
) -> tuple[Times, NDArray[np.bool_]]:
    """The middle offset of each stretch's messages from a reference, and whether most are near it. Shape [m]."""
    half = period_ns // 2
    one = len(lengths) == 1
    since = t_ns - (reference if one else np.repeat(reference, lengths)) + half
    offset = since - since // period_ns * period_ns
    begin = np.cumsum(lengths) - lengths
    place = begin + (lengths - 1) // 2
    if one:
        middle = np.partition(offset, place[0])[place]
    else:
        number = np.repeat(np.arange(len(lengths)) * period_ns, lengths)
        middle = np.sort(number + offset)[place] - np.arange(len(lengths)) * period_ns
    near = np.abs(offset - (middle if one else np.repeat(middle, lengths))) <= period_ns // 10
    return middle - half, 2 * np.add.reduceat(near.astype(np.int64), begin) > lengths


def instants(start_ns: Times, end_ns: Times, phase_ns: Times, period_ns: int) -> Grid:
    """The instants of each stretch's phase from its start to its end; all arrays have shape [m].

    An instant that misses an end by `ON_GRID_NS` still counts.
    """
    first = -((ON_GRID_NS + phase_ns - start_ns) // period_ns)
    last = (end_ns + ON_GRID_NS - phase_ns) // period_ns
    rows = np.maximum(last - first + 1, 0)
    begin = np.concatenate([[0], np.cumsum(rows)])
    if len(rows) == 1:
        t_ns = (first + np.arange(begin[-1])) * period_ns + phase_ns
    else:
        t_ns = np.repeat((first - begin[:-1]) * period_ns + phase_ns, rows) + np.arange(begin[-1]) * period_ns
    return Grid(t_ns, begin, period_ns)
