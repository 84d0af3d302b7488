"""cdr payloads (ROS 2) to columns, many messages at a time.

Equal to the library's decoder to the last bit; what this module does not vouch for, the library decides.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.decode.cdr_cursor import MOST_STEPS, Column, Cursor, advance
from maglev_offline.logs.decode.cdr_plan import Number, Place, Segment, Source, Step, Time, find, make_steps
from maglev_offline.logs.decode.payloads import NO_TIME, ColumnDecoder, Decoded, Payloads, Wanted, unwritten
from maglev_offline.logs.decode.ros2_definitions import read_message_type

FIXED, CURSOR = "fixed_layout", "cursor"

_ENCAPSULATION = 4
_ORDERS = {1: "<", 0: ">"}
"""The second byte of a payload of plain cdr tells the byte order; the first is zero."""

_BLOCK = 16_384
"""Messages that are read side by side: enough to pay for the calls, few enough to bound the memory."""

_NS = 1_000_000_000
_SMALL = 4_000_000_000
_STEEPEST_UNIT = 1e200


def compile_cdr(schema_name: str, schema: bytes, wanted: Wanted) -> tuple[ColumnDecoder, ...]:
    """Return the decoder for a schema: by fixed layout where a message has no strings and sequences, else a cursor.

    Empty where neither can serve it. The schema is taken to be one that the library reads.
    """
    slots: dict[Place, int] = {}
    try:
        top = read_message_type(schema_name, schema)
        sources = tuple(find(top, path, slots) for path in wanted.paths)
        stamp = find(top, tuple(wanted.clock.path.split(".")), slots) if wanted.clock else None
        steps = make_steps(top, slots)
    except ValueError:
        return ()
    ns_per_unit = wanted.clock.ns_per_unit if wanted.clock else 0.0
    if not abs(ns_per_unit) < _STEEPEST_UNIT:
        return ()
    rung = FIXED if len(steps) == 1 and isinstance(steps[0], Segment) else CURSOR
    return (CdrColumns(rung, wanted, ns_per_unit, sources, stamp, steps),)


@dataclass(frozen=True)
class CdrColumns:
    """Reads the wanted columns of one schema by its steps (see `cdr_plan`)."""

    rung: str
    wanted: Wanted
    ns_per_unit: float
    sources: tuple[Source, ...]
    stamp: Source
    steps: tuple[Step, ...]

    def decode(self, payloads: Payloads) -> Decoded:
        """Read the wanted columns; not sure are messages that are cut off or hold what cannot be."""
        n = len(payloads)
        found = unwritten(len(self.wanted.paths), n, stamped=self.wanted.clock is not None)
        found.values[[source is None for source in self.sources]] = np.nan
        if found.stamp_ns is not None and self.stamp is None:
            found.stamp_ns[:] = NO_TIME
        data = np.ascontiguousarray(payloads.data)
        # Signalling NaNs and floats beyond the range of int64 are data, and no reason to warn.
        with np.errstate(all="ignore"):
            for first in range(0, n, _BLOCK):
                block = slice(first, min(first + _BLOCK, n))
                self._decode_block(data, payloads.start[block], payloads.length[block], _cut(found, block))
        return found

    def _decode_block(
        self, data: NDArray[np.uint8], start: NDArray[np.int64], length: NDArray[np.int64], found: Decoded
    ) -> None:
        inside = (length >= _ENCAPSULATION) & (start >= 0) & (start <= len(data) - length)
        if not inside.any():
            return
        base = np.where(inside, start, 0)
        inside &= data[base] == 0
        kinds = data[base + 1]
        for kind, order in _ORDERS.items():
            chosen = (kinds == kind) & inside
            if not chosen.any():
                continue
            rows: slice | NDArray[np.intp] = slice(None) if chosen.all() else np.flatnonzero(chosen)
            cursor = Cursor(data, base[rows] + _ENCAPSULATION, length[rows] - _ENCAPSULATION, order)
            advance(cursor, self.steps, [MOST_STEPS])
            for column, source in zip(found.values, self.sources, strict=True):
                if source is not None:
                    column[rows] = _numbers(source, cursor.columns)
            if found.stamp_ns is not None and self.stamp is not None:
                found.stamp_ns[rows] = _stamps(self.stamp, cursor.columns, self.ns_per_unit)
            found.sure[rows] = cursor.ok


def _cut(found: Decoded, block: slice) -> Decoded:
    """The same arrays, but only the messages of a block."""
    stamps = None if found.stamp_ns is None else found.stamp_ns[block]
    return Decoded(found.values[:, block], stamps, found.sure[block])


def _numbers(source: Number | Time, columns: dict[int, Column]) -> NDArray[Any]:
    if isinstance(source, Time):
        total, beyond, present = _total_ns(source, columns)
        values = total.astype(np.float64) / 1e9
        for row, exact in beyond.items():
            values[row] = exact / 1e9
    else:
        values, present = columns[source.slot]
    return values if present is None else np.where(present, values.astype(np.float64), np.nan)


def _stamps(source: Number | Time, columns: dict[int, Column], ns_per_unit: float) -> NDArray[np.int64]:
    if isinstance(source, Time):
        stamps, beyond, present = _total_ns(source, columns)
        for row, exact in beyond.items():
            stamps[row] = exact if -(2**63) < exact < 2**63 else NO_TIME
    else:
        raw, present = columns[source.slot]
        whole = round(ns_per_unit)
        exact_unit = math.isclose(whole, ns_per_unit, rel_tol=1e-12)
        if raw.dtype.kind in "iu" and exact_unit:
            stamps = _whole_times(raw, whole)
        else:
            product = np.rint(raw.astype(np.float64) * ns_per_unit)
            stamps = np.where(np.abs(product) < 2.0**63, product, float(NO_TIME)).astype(np.int64)
    return stamps if present is None else np.where(present, stamps, NO_TIME)


def _whole_times(raw: NDArray[Any], unit: int) -> NDArray[np.int64]:
    """raw * unit, `NO_TIME` where it is beyond int64."""
    most = (2**63 - 1) // max(abs(unit), 1)
    fits = raw <= most if raw.dtype.kind == "u" else (raw <= most) & (raw >= -most)
    small = np.where(fits, raw, 0).astype(np.int64)
    return np.where(fits, small * (unit if most else 0), NO_TIME)


def _total_ns(
    source: Time, columns: dict[int, Column]
) -> tuple[NDArray[np.int64], dict[int, int], NDArray[np.bool_] | None]:
    """Nanoseconds of times in two parts; apart, by row, those that may be beyond int64; and where there are any."""
    seconds, present = columns[source.seconds]
    rest = columns[source.nanoseconds].raw
    # To Python a truth value is an integer, 1 for every byte but zero.
    seconds, rest = (raw.view(np.uint8) != 0 if raw.dtype.kind == "b" else raw for raw in (seconds, rest))
    total = seconds.astype(np.int64) * _NS + rest.astype(np.int64)
    if max(seconds.dtype.itemsize, rest.dtype.itemsize) < 8:
        return total, {}, present
    large = (seconds > _SMALL) | (rest > _SMALL * _NS)
    large |= (seconds.astype(np.float64) < -_SMALL) | (rest.astype(np.float64) < -_SMALL * _NS)
    beyond = {row: int(seconds[row]) * _NS + int(rest[row]) for row in np.flatnonzero(large).tolist()}
    return total, beyond, present
