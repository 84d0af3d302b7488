"""From messages to values on the grid, one function for each policy; nothing is said beyond the messages.

Each takes the place of the rows among the messages of a topic and the values of a signal of it, shape [messages], and
returns values and origins, shape [rows]. A row with a message on its instant has that message's value, bit for bit.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.grid import ON_GRID_NS, Times
from maglev_offline.ingest.placing import Index, Mask, Place, rank

Values = NDArray[np.float64]
Origins = NDArray[np.int8]


class Origin(IntEnum):
    """Where a value of the samples table comes from."""

    MEASURED = 0
    INTERPOLATED = 1
    HELD = 2
    RECONSTRUCTED = 3
    FILTERED = 4
    AVERAGED = 5
    BRIDGED = 6


ORIGINS = tuple(origin.name.lower() for origin in Origin)

SILENCE, ASTRAY = 1.5, 0.25
"""A silence of so many periods holds no message where one was due; a value so many periods from its message is
another's, and not one that jitter has moved."""


def at_instant(place: Place, values: Values) -> tuple[Values, Origins]:
    """The value at the instant, on a straight line between two messages where none is there; otherwise NaN."""
    if place.all_hit:
        return values[place.nearest], origins(place, Origin.MEASURED)
    # The indices are all within; to clip them takes numpy less time than to look for one that is not.
    behind = values.take(place.before, mode="clip")
    # A context value may be infinite, and a difference of two that are makes the NaN that it should.
    with np.errstate(over="ignore", invalid="ignore"):
        found = values.take(place.after, mode="clip")
        found -= behind
        found *= place.weight
        found += behind
    if place.outside is not None:
        found[place.outside] = np.nan
    found[place.hits] = values[place.nearest[place.hits]]
    return found, origins(place, Origin.INTERPOLATED)


def hold(place: Place, values: Values, tolerance_ns: int = 0) -> tuple[Values, Origins]:
    """The latest message, as a digital output holds it; NaN before the first one.

    A message that jitter puts up to `tolerance_ns` behind an instant counts as being there: the one before it would
    be a whole period old.
    """
    latest, lost = place.latest(tolerance_ns)
    return _taken(values, latest, lost), origins(place, Origin.HELD)


def nearest(place: Place, values: Values) -> tuple[Values, Origins]:
    """The nearest message, before or after: `held` says that it is one of another time, unchanged."""
    lost = place.stop <= place.first
    if place.longest_ns is not None:
        lost = lost | (np.abs(place.t_ns[place.nearest] - place.grid.t_ns) > place.longest_ns)
    return _taken(values, place.nearest, lost if lost.any() else None), origins(place, Origin.HELD)


def step_mean(place: Place, values: Values, tolerance_ns: int = 0) -> tuple[Values, Origins]:
    """The mean over the step that follows the instant, each message held until the next.

    A step that the messages do not reach the end of, or that holds no further message, has the held value.
    """
    found, origin = hold(place, values, tolerance_ns)
    start, t_ns = place.grid.t_ns, place.t_ns
    end = start + place.grid.period_ns
    # A message that misses an instant by ON_GRID_NS is there, at either end of the step.
    latest, lost = place.latest(ON_GRID_NS)
    final = np.clip(rank(t_ns, end - ON_GRID_NS, place.grid.begin, place.bounds, "left"), place.first, place.stop) - 1
    full = (t_ns[np.maximum(place.stop - 1, 0)] >= end - ON_GRID_NS) & (final > latest)
    rows = np.flatnonzero(full if lost is None else full & ~lost)
    if len(rows):
        found[rows] = _mean_between(t_ns, values, start[rows], end[rows], latest[rows], final[rows])
        origin[rows] = Origin.AVERAGED
    return found, origin


def _mean_between(t_ns: Times, values: Values, start: Times, end: Times, head: Index, tail: Index) -> Values:
    """Means of a held signal from `start` to `end`; `head` is its message at the start, `tail` > `head` at the end."""
    with np.errstate(over="ignore", invalid="ignore"):
        held = np.append(values[:-1] * np.diff(t_ns), 0.0)
        inner = np.add.reduceat(held, np.column_stack([head + 1, tail]).ravel())[::2]
        # `reduceat` answers an empty range with its first element.
        inner = np.where(tail > head + 1, inner, 0.0)
        ends = values[head] * (t_ns[head + 1] - start) + values[tail] * (end - t_ns[tail])
        mean: Values = (inner + ends) / (end - start)
    return mean


def origins(place: Place, otherwise: Origin) -> Origins:
    """`measured`, which is 0, where a message lies on the instant."""
    return place.not_hit * np.int8(otherwise)


def bridged(place: Place, period_ns: float) -> Mask:
    """Rows [rows] whose own message is missing: the messages about them lie more than `SILENCE` periods apart, and the
    nearest is more than `ASTRAY` periods away. `period_ns`: the grid's or the source's, whichever is greater."""
    silence: Mask = place.t_after - place.t_before > SILENCE * period_ns
    if not silence.any():
        return silence
    away = np.minimum(place.grid.t_ns - place.t_before, place.t_after - place.grid.t_ns)
    found: Mask = silence & place.not_hit & (away > ASTRAY * period_ns)
    return found


def _taken(values: Values, index: Index, lost: Mask | None) -> Values:
    found = values.take(index, mode="clip")
    if lost is not None:
        found[np.broadcast_to(lost, found.shape)] = np.nan
    return found
