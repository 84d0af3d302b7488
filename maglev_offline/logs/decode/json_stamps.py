"""Time stamps from columns of JSON numbers, to the last bit what `clock_ns` makes of each number alone."""

import math

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.decode.payloads import NO_TIME

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_TWO_63 = 2.0**63
_EXACT = 2.0**53
"""Below it every integer is a float64."""

_LAST_SECOND, _LAST_NANOSECOND = 4 * 10**9, 2**62
"""Up to here seconds and nanoseconds add up within int64."""


def of_parts(seconds: Ints, nanoseconds: Ints) -> tuple[Ints, Flags]:
    """Stamps [n] in nanoseconds from their two parts, and where that is certain."""
    sure = (np.abs(seconds) < _LAST_SECOND) & (np.abs(nanoseconds) < _LAST_NANOSECOND)
    # The most negative int64 is its own absolute value.
    sure &= (seconds != NO_TIME) & (nanoseconds != NO_TIME)
    return np.where(sure, seconds, 0) * 1_000_000_000 + np.where(sure, nanoseconds, 0), sure


def of_ints(values: Ints, ns_per_unit: float) -> tuple[Ints, Flags]:
    """Stamps [n] from numbers that were written as integers, and where that is certain."""
    whole = round(ns_per_unit)
    if not math.isclose(whole, ns_per_unit, rel_tol=1e-12):
        return _rounded(values.astype(np.float64), ns_per_unit)
    if not 0 < whole < 2**62:
        return np.full(len(values), NO_TIME, dtype=np.int64), np.zeros(len(values), dtype=np.bool_)
    most = (2**63 - 1) // whole
    fits = (values >= -most) & (values <= most)
    return np.where(fits, np.where(fits, values, 0) * whole, NO_TIME), np.ones(len(values), dtype=np.bool_)


def of_floats(values: Floats, ns_per_unit: float) -> tuple[Ints, Flags]:
    """Stamps [n] from numbers of which nobody knows whether they were written as integers; NaN is no time.

    Certain is a stamp that comes out the same both ways.
    """
    stamps, sure = _rounded(values, ns_per_unit)
    sure |= np.isnan(values)
    whole = np.flatnonzero(values == np.rint(values))
    if len(whole):
        small = np.abs(values[whole]) < _EXACT
        other, certain = of_ints(np.where(small, values[whole], 0.0).astype(np.int64), ns_per_unit)
        sure[whole] &= small & certain & (other == stamps[whole])
    return stamps, sure


def _rounded(values: Floats, ns_per_unit: float) -> tuple[Ints, Flags]:
    with np.errstate(over="ignore", invalid="ignore"):
        nanoseconds = values * ns_per_unit
    rounded = np.rint(nanoseconds)
    fits = np.abs(rounded) < _TWO_63
    return np.where(fits, np.where(fits, rounded, 0.0).astype(np.int64), NO_TIME), np.isfinite(nanoseconds)
