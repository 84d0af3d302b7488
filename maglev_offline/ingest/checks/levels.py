"""Values that stand still, lie at an extreme, or jump away and back. All arrays have shape [n], in time order."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.checks.timing import runs

Array = NDArray[np.float64]
Index = NDArray[np.int64]


MEASURED = ("gap", "velocity", "current", "voltage")
"""Set-points and context may stand still, come in steps and lie at their limits with good reason."""


def constant_runs(values: Array, least: int) -> tuple[Index, Index]:
    """First and last index of runs of one value in at least `least` messages."""
    hop = max(least // 2, 1)
    probes = values[::hop]
    # A run of `least` values holds two probes in a row: the common case ends here, at a fraction of the values.
    if not np.any(probes[1:] == probes[:-1]):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    first, last = runs(values[1:] == values[:-1])
    last = last + 1
    long = last - first + 1 >= least
    return first[long], last[long]


def resting(values: Array, first: Index, last: Index, step: float, starts: Index) -> NDArray[np.bool_]:
    """Runs of one value that a quantised signal enters and leaves by about one `step`: it rests on a level there.

    A run that the log or a stretch cuts off shows one of its ends only. It rests where another run of at least a third
    of its length does so between two ends that are seen.
    """
    before, after = np.maximum(first - 1, 0), np.minimum(last + 1, len(values) - 1)
    near = [np.abs(values[beside] - values[first]) <= 1.5 * step for beside in (before, after)]
    cut = [np.isin(first, starts), np.isin(last + 1, starts) | (last == len(values) - 1)]
    whole = near[0] & near[1] & ~cut[0] & ~cut[1]
    length = last - first + 1
    longest = int(length[whole].max()) if whole.any() else 0
    partly = (near[0] | cut[0]) & (near[1] | cut[1]) & (length <= 3 * longest)
    rests: NDArray[np.bool_] = whole | partly
    return rests


def moving(others: Mapping[str, Array], spread: Mapping[str, float], first: int, last: int, share: float) -> str:
    """The signal that moves most in a stretch, in its own standard deviations; empty where none moves by `share`."""
    moves = {
        name: float(np.ptp(values[first : last + 1])) / spread[name]
        for name, values in others.items()
        if spread[name] > 0
    }
    most = max(moves, key=lambda name: moves[name], default="")
    return most if most and moves[most] > share else ""


def pile(
    values: Array, extreme: float, inward: float, most_share: float, step: float | None = None
) -> NDArray[np.bool_] | None:
    """Messages at an extreme where they pile up, else None. `inward` is the span of all values, signed to the inside.

    They pile up where a band of 1/500 of the span at the extreme holds `most_share` of all, and five times as many as
    each of the next four bands on average: the tail of free values thins out towards its end. For a signal that comes
    in greater steps than that, a band is one level.
    """
    band, edge = abs(inward) / 500, 1.0
    if step is not None and step > band:
        band, edge = step, 0.5
    inside = (values - extreme) * (np.sign(inward) / band)
    at = inside <= edge
    held = int(np.count_nonzero(at))
    if held < max(most_share * len(values), 5):
        return None
    beside = int(np.count_nonzero(inside <= edge + 4)) - held
    return at if held > 5 * max(beside / 4, 1) else None


def spikes(values: Array, factor: float, starts: Index, set_point: Array | None = None) -> Index:
    """Single values that lie off the line through both neighbours by `factor` times the signal's usual bend.

    All three lie in one stretch; `starts` are the first messages of the stretches. What answers to a step of the
    set-point is none.
    """
    if len(values) < 16:
        return np.empty(0, dtype=np.int64)
    size = values[:-2] + values[2:]
    size *= -0.5
    size += values[1:-1]
    np.abs(size, out=size)
    some = np.sort(size[:: max(len(size) // 1024, 1)])
    # The greater bends stand in for the usual one of a quantised signal, most of whose bends are 0.
    usual = max(float(some[len(some) // 2]), 0.2 * float(some[int(0.95 * (len(some) - 1))]))
    if usual == 0 or size.max() <= factor * usual:
        return np.empty(0, dtype=np.int64)
    at = np.flatnonzero(size > factor * usual)
    # A step of the signal bends it twice, one way and the other; a spike stands alone between two equal neighbours.
    size, middle = size[at], at + 1
    alone = np.abs(values[middle + 1] - values[middle - 1]) < 0.25 * size
    alone &= ~(np.isin(middle, starts) | np.isin(middle + 1, starts))
    # The crest of a steep swing bends as much, but there the signal runs up to it and down from it.
    up = np.abs(values[middle - 1] - values[np.maximum(middle - 2, 0)])
    down = np.abs(values[np.minimum(middle + 2, len(values) - 1)] - values[middle + 1])
    up[np.isin(middle - 1, starts)] = 0
    down[np.isin(middle + 2, starts)] = 0
    alone &= np.minimum(up, down) < 0.5 * size
    if set_point is not None:
        alone &= ~_at_step(set_point, middle)
    found: Index = middle[alone]
    return found


def _at_step(set_point: Array, at: Index) -> NDArray[np.bool_]:
    """Whether each message is the first or the second after a lone step of the set-point; a ramp has none."""
    steps = np.concatenate([[False], set_point[1:] != set_point[:-1], [False, False]])
    stepped = steps[at].astype(np.int64) + steps[at - 1]
    beside = steps[np.maximum(at - 2, 0)].astype(np.int64) + steps[at + 1] + steps[at + 2]
    found: NDArray[np.bool_] = (stepped == 1) & (beside == 0)
    return found
