"""From the messages of one stretch to values on the grid; nothing is said beyond the stretch's own messages.

The grid is uniform in integer nanoseconds, and its phase is that of the messages: between samples of 100 ms the gap
turns by up to 3 rad, so a row in the middle between two messages would be an invention (docs/decisions/0007).
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

ON_GRID_NS = 1000
"""A message within a microsecond of a grid instant was measured there."""


class Origin(IntEnum):
    """Where a value of the samples table comes from."""

    MEASURED = 0
    INTERPOLATED = 1
    HELD = 2
    RECONSTRUCTED = 3


ORIGINS = tuple(origin.name.lower() for origin in Origin)

Times = NDArray[np.int64]
Values = NDArray[np.float64]


def grid_phase(t_ns: Times, grid_ns: int) -> int:
    """Phase in [0, grid_ns) that most messages keep to within a tenth of the period: that of the middle one of them.

    Messages that lie on a grid already give its phase exactly. Where they keep to none, as a source that is faster
    than the grid, it is the phase of the first message.
    """
    half = grid_ns // 2
    offset = (t_ns - t_ns[0] + half) % grid_ns - half
    middle = np.partition(offset, (len(offset) - 1) // 2)[(len(offset) - 1) // 2]
    together = np.abs(offset - middle) <= grid_ns // 10
    return int((t_ns[0] + (middle if 2 * together.sum() > len(offset) else 0)) % grid_ns)


def grid_instants(start_ns: int, end_ns: int, grid_ns: int, phase_ns: int = 0) -> Times:
    """Instants of that phase from `start_ns` to `end_ns`; one that misses an end by `ON_GRID_NS` still counts."""
    first = -((ON_GRID_NS + phase_ns - start_ns) // grid_ns)
    last = (end_ns + ON_GRID_NS - phase_ns) // grid_ns
    return np.arange(first, last + 1, dtype=np.int64) * grid_ns + phase_ns


def interpolate(t_ns: Times, values: Values, grid_ns: Times) -> tuple[Values, NDArray[np.int8]]:
    """Interpolate linearly between messages in time order; returns the values and their origins, shape [grid].

    An instant with a message has that message's value, untouched. An instant outside the messages is NaN.
    """
    nearest, hit = _on_grid(t_ns, grid_ns)
    # Times since the first message fit into a float64 to the nanosecond; absolute ones do not.
    seconds = (t_ns - t_ns[0]).astype(np.float64)
    between = np.interp((grid_ns - t_ns[0]).astype(np.float64), seconds, values, left=np.nan, right=np.nan)
    return (
        np.where(hit, values[nearest], between),
        np.where(hit, Origin.MEASURED, Origin.INTERPOLATED).astype(np.int8),
    )


def hold(t_ns: Times, values: Values, grid_ns: Times, tolerance_ns: int = 0) -> tuple[Values, NDArray[np.int8]]:
    """Hold the latest message, as a digital output does; returns the values and their origins, shape [grid].

    A message that jitter puts up to `tolerance_ns` behind an instant counts as being there: the one before it would
    be a whole period old. An instant before the first message is NaN.
    """
    nearest, hit = _on_grid(t_ns, grid_ns)
    latest = np.searchsorted(t_ns, grid_ns + tolerance_ns, side="right") - 1
    held = np.where(latest >= 0, values[np.maximum(latest, 0)], np.nan)
    return np.where(hit, values[nearest], held), np.where(hit, Origin.MEASURED, Origin.HELD).astype(np.int8)


def _on_grid(t_ns: Times, grid_ns: Times) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the nearest message of each instant, and whether it lies on it."""
    after = np.searchsorted(t_ns, grid_ns).clip(0, len(t_ns) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(t_ns[before] - grid_ns) < np.abs(t_ns[after] - grid_ns), before, after)
    return nearest, np.abs(t_ns[nearest] - grid_ns) <= ON_GRID_NS
