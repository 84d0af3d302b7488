"""From raw protobuf values to the columns: numbers as float64, stamps as integer nanoseconds, times of two parts."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.decode.payloads import NO_TIME, Decoded
from maglev_offline.logs.decode.protobuf_plan import Default, Want
from maglev_offline.logs.decode.protobuf_types import Kind
from maglev_offline.logs.decode.varints import unzigzag

_MOST_SECONDS, _MOST_NANOSECONDS = 9_000_000_000, 200_000_000_000_000_000
"""Within these the sum is an int64; the library reckons what is beyond."""

Rows = NDArray[np.int64] | None


class Columns:
    """Writes into what was found so far (NaN and `NO_TIME`); the parts of times [slots, n] wait for each other."""

    def __init__(self, found: Decoded, slots: int, ns_per_unit: float) -> None:
        self.values, self.stamp_ns, sure = found
        self._ns_per_unit = ns_per_unit
        self._parts = np.zeros((slots, len(sure)), dtype=np.int64)

    def put(self, want: Want, raw: NDArray[Any], rows: Rows) -> None:
        """Put raw values [k], numbers of any type, where they are wanted in the rows [k]."""
        if want.values:
            with np.errstate(invalid="ignore"):  # a signalling NaN in float32
                numbers = raw.astype(np.float64)
            for row in want.values:
                _write(self.values[row], rows, numbers)
        if want.clock and self.stamp_ns is not None:
            _write(self.stamp_ns, rows, stamps_ns(raw, self._ns_per_unit))
        for slot in want.parts:
            if raw.dtype.kind == "u":
                raw = np.minimum(raw, np.iinfo(np.int64).max, dtype=np.uint64)
            _write(self._parts[slot], rows, raw)

    def put_varint(self, want: Want, value: NDArray[np.uint64], kind: Kind, rows: Rows) -> None:
        """Put what varints [k] of this kind stand for."""
        self.put(want, _meaning(value, kind), rows)

    def put_defaults(self, left_out: Sequence[Default], rows: Rows) -> None:
        """Put the value of a field that is left out."""
        where = slice(None) if rows is None else rows
        for want, default in left_out:
            for row in want.values:
                self.values[row, where] = default
            for slot in want.parts:
                self._parts[slot, where] = default
            if want.clock and self.stamp_ns is not None:
                self.stamp_ns[where] = default

    def put_time(self, want: Want, rows: Rows) -> NDArray[np.bool_]:
        """Put a time whose two parts have been read; return where [k] it is too large to be reckoned here."""
        assert want.time is not None
        where = slice(None) if rows is None else rows
        seconds, rest = (self._parts[slot, where] for slot in want.time)
        far = (seconds > _MOST_SECONDS) | (seconds < -_MOST_SECONDS)
        far |= (rest > _MOST_NANOSECONDS) | (rest < -_MOST_NANOSECONDS)
        nanoseconds = seconds * 1_000_000_000 + rest
        for row in want.values:
            _write(self.values[row], rows, nanoseconds / 1e9)
        if want.clock and self.stamp_ns is not None:
            _write(self.stamp_ns, rows, nanoseconds)
        return far


def _write(column: NDArray[Any], rows: Rows, content: NDArray[Any]) -> None:
    column[slice(None) if rows is None else rows] = content


def _meaning(value: NDArray[np.uint64], kind: Kind) -> NDArray[Any]:
    """Numbers from 64-bit varints; the types of 32 bits take the lower half, as the library does."""
    match kind:
        case Kind.INT64:
            return value.view(np.int64)
        case Kind.INT32 | Kind.ENUM:
            return value.astype(np.uint32).view(np.int32)
        case Kind.UINT32:
            return value.astype(np.uint32)
        case Kind.SINT64:
            return unzigzag(value)
        case Kind.SINT32:
            return unzigzag(value & np.uint64(0xFFFFFFFF))
        case Kind.BOOL:
            truth: NDArray[np.int64] = (value != 0).astype(np.int64)
            return truth
    return value


def stamps_ns(raw: NDArray[Any], ns_per_unit: float) -> NDArray[np.int64]:
    """Integer nanoseconds [n] of plain numbers, `NO_TIME` out of the range of int64: `library.clock_ns` for arrays."""
    whole = round(ns_per_unit)
    if raw.dtype.kind in "iu" and math.isclose(whole, ns_per_unit, rel_tol=1e-12):
        most = np.iinfo(np.int64).max // whole
        wide = raw.astype(np.uint64 if raw.dtype.kind == "u" else np.int64)
        there = (wide <= most) & (wide >= (0 if raw.dtype.kind == "u" else -most))
        exact: NDArray[np.int64] = np.where(there, wide, 0).astype(np.int64) * whole
        exact[~there] = NO_TIME
        return exact
    with np.errstate(invalid="ignore", over="ignore"):
        rounded = np.rint(raw.astype(np.float64) * ns_per_unit)
        there = np.abs(rounded) < 2.0**63
    stamps: NDArray[np.int64] = np.where(there, np.where(there, rounded, 0).astype(np.int64), NO_TIME)
    return stamps
