"""Zero-phase low-pass of a source that is faster than the grid, evaluated at the exact grid instants.

The filter is a Kaiser-windowed sinc over true times: a message weighs the kernel at its distance from the instant times
the time that it stands for, and the weights of a row sum to one. So jitter needs no resampling beforehand, the gain at
rest is exact, and a symmetric kernel turns no phase. Figures are in docs/decisions/0008, and the tests hold them.
"""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.placing import Index, Mask, Place, rank
from maglev_offline.ingest.resample import Origin, Origins, Values, at_instant

HALF_WIDTH = 8.0
"""Half the kernel, in grid periods."""

CUTOFF = 0.385
"""Where the gain is one half, in cycles for a grid period; the grid's Nyquist frequency is at 0.5."""

PASS_EDGE, STOP_EDGE = 0.27, 0.5
"""The gain is one to within `RIPPLE` up to the first, and below `RIPPLE` from the second on, where messages come at
regular times. Cycles for a grid period."""

RIPPLE = 2e-3
"""54 dB; 60 dB from a source that is twice as fast as the grid, or more."""

KAISER_BETA = 5.65
"""Of Kaiser's window for 60 dB."""

_SHARE_NOT_FINITE = 0.1
"""A row of a context column is NaN where more than this share of its kernel's weight falls on missing values."""

_TAPS_AT_ONCE = 1 << 15


def kernel(distance: Values, half_width: Values | float = HALF_WIDTH) -> Values:
    """The kernel at distances from the instant; both in grid periods, and distances at most the half width."""
    away = np.abs(distance)
    window = np.i0(KAISER_BETA * np.sqrt(np.maximum(1.0 - (away / half_width) ** 2, 0.0))) / np.i0(KAISER_BETA)
    found: Values = np.sinc(2.0 * CUTOFF * away) * window
    return found


_KNOTS_A_PERIOD = 1024
"""Between knots the whole kernel is straight to within 1e-6 of its peak."""

_TABLE = kernel(np.arange(int(HALF_WIDTH) * _KNOTS_A_PERIOD + 2) / _KNOTS_A_PERIOD)
_SLOPE = np.diff(_TABLE)


def _whole_kernel(distance: Values) -> Values:
    """As `kernel`, by table: it is most of the work."""
    away = np.abs(distance)
    away *= _KNOTS_A_PERIOD
    knot = away.astype(np.int32)
    away -= knot
    away *= _SLOPE[knot]
    away += _TABLE[knot]
    return away


class Filter:
    """The low-pass for all signals of one topic: reach and kernels belong to the times, and are found once."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.rows, self.reach_ns, self.whole, self.stands_for = _reach(place)
        self._weights: list[tuple[slice, Index, Index, Values, Values]] | None = None

    def __call__(self, values: Values) -> tuple[Values, Origins]:
        """Values and origins of one signal. `interpolated` are rows that the whole kernel does not fit about.

        Towards the ends of a run the kernel narrows on both sides alike: it keeps its phase and loses attenuation,
        until less than a period is left and the row has the value at its instant.
        """
        found, origin = at_instant(self.place, values)
        usable = np.isfinite(values)
        whole_signal = bool(usable.all())
        if self._weights is None:
            self._weights = self._kernels()
        for part, index, begin, weights, total in self._weights:
            rows = self.rows[part]
            taken = values[index]
            if whole_signal:
                found[rows] = np.add.reduceat(weights * taken, begin) / total
            else:
                found[rows] = _of_finite(weights, taken, usable[index], begin)
        origin[self.rows] = np.where(self.whole, Origin.FILTERED, Origin.INTERPOLATED)
        return found, origin

    def _kernels(self) -> list[tuple[slice, Index, Index, Values, Values]]:
        """For slices of the rows: messages under their kernels, where each row's begin, weights and their sums."""
        place, here = self.place, self.place.grid.t_ns[self.rows]
        if len(here) == 0:
            return []
        reach = np.zeros(len(place.grid.t_ns), dtype=np.int64)
        reach[self.rows] = self.reach_ns
        first = rank(place.t_ns, place.grid.t_ns - reach, place.grid.begin, place.bounds, "left")
        after_last = rank(place.t_ns, place.grid.t_ns + reach, place.grid.begin, place.bounds, "right")
        low = np.maximum(first, place.first)[self.rows]
        high = np.minimum(after_last, place.stop)[self.rows]
        taps = high - low
        ends = np.cumsum(taps)
        parts = []
        done = 0
        while done < len(taps):
            stop = int(np.searchsorted(ends, (ends[done - 1] if done else 0) + _TAPS_AT_ONCE, side="right"))
            part = slice(done, max(stop, done + 1))
            count = taps[part]
            begin = np.cumsum(count) - count
            index = np.repeat(low[part] - begin, count) + np.arange(int(count.sum()))
            period = float(place.grid.period_ns)
            distance = (place.t_ns[index] - np.repeat(here[part], count)) / period
            weights = _whole_kernel(distance)
            narrow = np.repeat(~self.whole[part], count)
            if narrow.any():
                weights[narrow] = kernel(distance[narrow], np.repeat(self.reach_ns[part] / period, count)[narrow])
            weights *= self.stands_for[index]
            parts.append((part, index, begin, weights, np.add.reduceat(weights, begin)))
            done = part.stop
        return parts


def _reach(place: Place) -> tuple[NDArray[np.intp], Index, Mask, Values]:
    """The rows to filter, how far the kernel of each reaches (ns), whether that is the whole kernel; and the time
    that each message stands for (ns).

    A run of messages ends where the next is more than a grid period away: across such a silence the source is no
    faster than the grid, and there is nothing to filter.
    """
    t_ns, period = place.t_ns, place.grid.period_ns
    starts = np.zeros(len(t_ns), dtype=np.bool_)
    starts[0] = True
    step = np.diff(t_ns)
    starts[1:] = (step > period) | (step < 0)
    starts[place.bounds.first[place.bounds.stop > place.bounds.first]] = True
    starts[place.bounds.stop[place.bounds.stop < len(t_ns)]] = True
    begins = np.flatnonzero(starts)
    run = np.cumsum(starts) - 1
    run_start, run_end = t_ns[begins], t_ns[np.append(begins[1:], len(t_ns)) - 1]

    # Half the way to the next message of the run, on either side.
    ahead = np.append(step, 0)
    ahead[np.append(begins[1:], len(t_ns)) - 1] = 0
    stands_for = (ahead + np.append(0, ahead[:-1])) / 2.0

    here = place.grid.t_ns
    mine = run[place.nearest]
    reach = np.minimum(here - run_start[mine], run_end[mine] - here)
    whole = round(HALF_WIDTH * period)
    rows = np.flatnonzero((reach >= period) & (place.stop > place.first))
    reach = reach[rows]
    return rows, np.minimum(reach, whole), reach >= whole, stands_for


def _of_finite(weights: Values, taken: Values, usable: Mask, begin: Index) -> Values:
    """Weighted means without the missing values; NaN where they would weigh too much."""
    share = np.abs(weights)
    missing = np.add.reduceat(np.where(usable, 0.0, share), begin)
    enough = missing <= _SHARE_NOT_FINITE * np.add.reduceat(share, begin)
    total = np.add.reduceat(np.where(usable, weights, 0.0), begin)
    found: Values = np.full(len(begin), np.nan)
    np.divide(np.add.reduceat(np.where(usable, weights * taken, 0.0), begin), total, out=found, where=enough)
    return found
