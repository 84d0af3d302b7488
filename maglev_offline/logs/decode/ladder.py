"""The ladder of decoders of one schema: the fastest first, the library's own, message by message, last."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from maglev_offline.logs.decode.cdr import compile_cdr
from maglev_offline.logs.decode.json_columns import compile_json
from maglev_offline.logs.decode.library import UNDECODABLE, Decoders, clock_ns, number, value_at
from maglev_offline.logs.decode.payloads import NO_TIME, ColumnDecoder, Decoded, Payloads, Wanted, nothing_sure
from maglev_offline.logs.decode.protobuf import compile_protobuf

LIBRARY, UNDECODABLE_RUNG = "library", "not_decodable"
"""How the last rung is counted, and the messages that it could not read either."""


class Columns(NamedTuple):
    """Columns of n messages: `values` [paths, n], `stamp_ns` [n] or None, and whether each could be read [n]."""

    values: NDArray[np.float64]
    stamp_ns: NDArray[np.int64] | None
    decoded: NDArray[np.bool_]


class Ladder:
    """Decodes the messages of one schema; `rungs` counts how many messages each way of decoding has read.

    Raises
    ------
    ValueError: the schema itself cannot be read, or no decoder knows the encoding.
    """

    def __init__(self, channel: Channel, schema: Schema | None, wanted: Wanted, decoders: Decoders) -> None:
        decoder = decoders.of(channel, schema)
        if decoder is None:
            encoding = schema.encoding if schema else ""
            raise ValueError(f"encoding {channel.message_encoding!r} with schema encoding {encoding!r} is not known")
        self._library = decoder
        self._wanted = wanted
        self._fast = _compile(channel, schema, wanted)
        self.rungs: Counter[str] = Counter()
        self.first_failure = ""

    def decode(self, payloads: Payloads) -> Columns:
        """Read all messages; what no rung can read is NaN, `NO_TIME` and not `decoded`."""
        n = len(payloads)
        rows = np.arange(n)
        found: Decoded | None = None
        for rung in self._fast:
            if len(rows) == 0:
                break
            part = payloads if len(rows) == n else Payloads(payloads.data, payloads.start[rows], payloads.length[rows])
            read = rung.decode(part)
            if len(rows) == n and read.sure.all():
                self.rungs[rung.rung] += n
                return Columns(read.values, read.stamp_ns, read.sure)
            found = found or self._nothing(n)
            sure = np.flatnonzero(read.sure)
            if len(sure):
                self.rungs[rung.rung] += len(sure)
                _put(found, rows[sure], read, sure)
                rows = np.delete(rows, sure)
        found = found or self._nothing(n)
        decoded = np.ones(n, dtype=np.bool_)
        for row in rows.tolist():
            decoded[row] = self._one(payloads, row, found)
        return Columns(found.values, found.stamp_ns, decoded)

    def _nothing(self, n: int) -> Decoded:
        return nothing_sure(self._wanted.paths, n, stamped=self._wanted.clock is not None)

    def _one(self, payloads: Payloads, row: int, found: Decoded) -> bool:
        try:
            content = self._library(payloads.of(row))
            numbers = [number(value_at(content, path)) for path in self._wanted.paths]
            clock = self._wanted.clock
            stamp = clock_ns(value_at(content, clock.path.split(".")), clock.ns_per_unit) if clock else None
        except UNDECODABLE as error:
            self.rungs[UNDECODABLE_RUNG] += 1
            self.first_failure = self.first_failure or f"{type(error).__name__}: {error}"
            return False
        self.rungs[LIBRARY] += 1
        found.values[:, row] = numbers
        if found.stamp_ns is not None:
            found.stamp_ns[row] = NO_TIME if stamp is None else stamp
        return True


def _put(found: Decoded, rows: NDArray[np.intp], read: Decoded, sure: NDArray[np.intp]) -> None:
    found.values[:, rows] = read.values[:, sure]
    if found.stamp_ns is not None and read.stamp_ns is not None:
        found.stamp_ns[rows] = read.stamp_ns[sure]


def _compile(channel: Channel, schema: Schema | None, wanted: Wanted) -> tuple[ColumnDecoder, ...]:
    match (channel.message_encoding, schema.encoding if schema else ""):
        case ("json", _):
            return compile_json(wanted)
        case ("cdr", "ros2msg") if schema is not None:
            return compile_cdr(schema.name, schema.data, wanted)
        case ("protobuf", "protobuf") if schema is not None:
            return compile_protobuf(schema.name, schema.data, wanted)
    return ()
