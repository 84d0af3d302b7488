"""From the messages of one stretch to values on the grid; nothing is said beyond the stretch's own messages.

Grid instants are the multiples of the grid period in absolute integer nanoseconds, so all logs share one grid.
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


def grid_instants(start_ns: int, end_ns: int, grid_ns: int) -> Times:
    """Multiples of `grid_ns` from `start_ns` to `end_ns`; one that misses an end by `ON_GRID_NS` still counts."""
    first = -((ON_GRID_NS - start_ns) // grid_ns)
    last = (end_ns + ON_GRID_NS) // grid_ns
    return np.arange(first, last + 1, dtype=np.int64) * grid_ns


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


def hold(t_ns: Times, values: Values, grid_ns: Times) -> tuple[Values, NDArray[np.int8]]:
    """Hold the latest message, as a digital output does; returns the values and their origins, shape [grid].

    An instant before the first message is NaN.
    """
    nearest, hit = _on_grid(t_ns, grid_ns)
    latest = np.searchsorted(t_ns, grid_ns, side="right") - 1
    held = np.where(latest >= 0, values[np.maximum(latest, 0)], np.nan)
    return np.where(hit, values[nearest], held), np.where(hit, Origin.MEASURED, Origin.HELD).astype(np.int8)


def _on_grid(t_ns: Times, grid_ns: Times) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the nearest message of each instant, and whether it lies on it."""
    after = np.searchsorted(t_ns, grid_ns).clip(0, len(t_ns) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(t_ns[before] - grid_ns) < np.abs(t_ns[after] - grid_ns), before, after)
    return nearest, np.abs(t_ns[nearest] - grid_ns) <= ON_GRID_NS
