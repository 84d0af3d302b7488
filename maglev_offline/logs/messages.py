"""The messages in a buffer of whole records: where each lies, and what its header says."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs import wire
from maglev_offline.logs.message_index import IndexEntries
from maglev_offline.logs.structure import MessageTable

_HEADER = np.dtype(
    {
        "names": ["opcode", "length", "channel_id", "sequence", "log_time", "publish_time"],
        "formats": ["u1", "<u8", "<u2", "<u4", "<u8", "<u8"],
        "offsets": [0, 1, 9, 11, 15, 23],
        "itemsize": 31,
    }
)
MESSAGE_HEAD = 31
"""Bytes of a Message record before its payload."""

_LOOK_AHEAD = 64
"""Records of equal length are looked for so many at a time at first, then ever more."""


class Chain(NamedTuple):
    """Consecutive records: their offsets, opcodes and lengths (without the 9 bytes of the head), each [n].

    `stop` is where the last one ends; short of the end of the buffer, what follows is no record.
    """

    offset: NDArray[np.int64]
    opcode: NDArray[np.uint8]
    length: NDArray[np.int64]
    stop: int


class Found(NamedTuple):
    """The messages of a buffer, and the offsets and lengths of its other records (heads included)."""

    messages: MessageTable
    others: list[tuple[int, int, int]]
    stop: int


def empty_table() -> MessageTable:
    """No message at all."""
    places = np.empty(0, dtype=np.int64)
    times = np.empty(0, dtype=np.uint64)
    return MessageTable(np.empty(0, np.uint16), np.empty(0, np.uint32), times, times, places, places)


def chain(data: NDArray[np.uint8], start: int, end: int, opcodes: frozenset[int] | None = None) -> Chain:
    """Follow the records from `start` as far as each lies whole before `end` and has one of the opcodes.

    Without `opcodes` every opcode but 0 will do. A Message record that is too short for its header is no record.
    """
    view = data.data
    offsets: list[NDArray[np.int64] | list[int]] = []
    single: list[int] = []
    kinds: list[int] = []
    lengths: list[int] = []
    repeats: list[int] = []
    at, before = start, (-1, -1)
    while at + 9 <= end:
        opcode, length = wire.HEAD.unpack_from(view, at)
        stride = 9 + length
        wanted = opcode != 0 if opcodes is None else opcode in opcodes
        if not wanted or at + stride > end or (opcode == wire.MESSAGE and length < 22):
            break
        n = 1
        if before == (opcode, length):
            n = _equal_heads(data, at, end, stride)
        if n > 1:
            offsets += [single, np.arange(at, at + n * stride, stride, dtype=np.int64)]
            single = []
        else:
            single.append(at)
        kinds.append(opcode)
        lengths.append(length)
        repeats.append(n)
        at += n * stride
        before = (opcode, length)
    offsets.append(single)
    times = np.array(repeats, dtype=np.int64)
    return Chain(
        np.concatenate([np.asarray(part, dtype=np.int64) for part in offsets]),
        np.repeat(np.array(kinds, dtype=np.uint8), times),
        np.repeat(np.array(lengths, dtype=np.int64), times),
        at,
    )


def _equal_heads(data: NDArray[np.uint8], at: int, end: int, stride: int) -> int:
    """How many records from `at` have the same opcode and length, at least 1."""
    most = (end - at) // stride
    known, look = 1, _LOOK_AHEAD
    while known < most:
        upto = min(known + look, most)
        heads = np.lib.stride_tricks.as_strided(data[at + known * stride :], (upto - known, 9), (stride, 1))
        differs = (heads != data[at : at + 9]).any(axis=1)
        first = int(differs.argmax())
        if differs[first]:
            return known + first
        known, look = upto, look * 4
    return known


def from_index(data: NDArray[np.uint8], entries: IndexEntries) -> Found | None:
    """The messages at the places that the index tells; None where these are not all messages, and only those."""
    size, n = len(data), len(entries.offset)
    if n and int(entries.offset.max()) > size - MESSAGE_HEAD:
        return None
    order = np.argsort(entries.offset, kind="stable")
    offset = entries.offset[order].view(np.int64)
    heads = _heads_at(data, offset)
    long = np.ascontiguousarray(heads["length"])
    if (heads["opcode"] != wire.MESSAGE).any() or (n and not 22 <= int(long.min()) <= int(long.max()) <= size):
        return None
    if (heads["channel_id"] != entries.channel_id[order]).any():
        return None
    if (heads["log_time"] != entries.log_time_ns[order]).any():
        return None
    length = long.view(np.int64)
    others = _between(data, offset, offset + length)
    return Found(_table(heads, offset, length), others, size) if others is not None else None


def _between(
    data: NDArray[np.uint8], offset: NDArray[np.int64], end: NDArray[np.int64]
) -> list[tuple[int, int, int]] | None:
    """The records between messages that end 9 bytes behind `end`; None where there is anything but whole other ones."""
    size = len(data)
    if not len(offset):
        gaps = [(0, size)] if size else []
    else:
        jumps = np.flatnonzero(offset[1:] - end[:-1] != 9)
        gaps = [(0, int(offset[0])), *((int(end[k]) + 9, int(offset[k + 1])) for k in jumps), (int(end[-1]) + 9, size)]
    others: list[tuple[int, int, int]] = []
    for first, last in gaps:
        records = chain(data, first, last)
        if first > last or records.stop != last or (records.opcode == wire.MESSAGE).any():
            return None
        others += _listed(records, slice(None))
    return others


def from_records(data: NDArray[np.uint8], opcodes: frozenset[int] | None = None) -> Found:
    """The messages found by going from record to record; `stop` is where that ends."""
    records = chain(data, 0, len(data), opcodes)
    is_message = records.opcode == wire.MESSAGE
    offset, length = records.offset[is_message], records.length[is_message]
    return Found(_table(_heads_at(data, offset), offset, length), _listed(records, ~is_message), records.stop)


def _listed(records: Chain, which: "slice | NDArray[np.bool_]") -> list[tuple[int, int, int]]:
    parts = (records.opcode[which], records.offset[which], records.length[which] + 9)
    return list(zip(*(part.tolist() for part in parts), strict=True))


def _heads_at(data: NDArray[np.uint8], offset: NDArray[np.int64]) -> NDArray[Any]:
    if not len(offset):
        return np.empty(0, dtype=_HEADER)
    # One header begins at every byte; only those at the offsets are gathered.
    # As plain bytes, since numpy copies records with named fields field by field, which is ten times slower.
    everywhere = np.ndarray((len(data) - MESSAGE_HEAD + 1,), np.dtype("V31"), buffer=data, strides=(1,))
    return everywhere[offset].view(_HEADER)


def _table(heads: NDArray[Any], offset: NDArray[np.int64], length: NDArray[np.int64]) -> MessageTable:
    return MessageTable(
        channel_id=np.ascontiguousarray(heads["channel_id"]),
        sequence=np.ascontiguousarray(heads["sequence"]),
        log_time_ns=np.ascontiguousarray(heads["log_time"]),
        publish_time_ns=np.ascontiguousarray(heads["publish_time"]),
        start=offset + MESSAGE_HEAD,
        length=length - 22,
    )
