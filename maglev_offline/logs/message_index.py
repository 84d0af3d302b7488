"""The MessageIndex records behind a chunk: for each channel the times and places of its messages."""

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs import wire

_INDEX_HEAD = struct.Struct("<BQHI")
"""Opcode, length of the record, channel id, bytes of the entries."""


class IndexEntries(NamedTuple):
    """The n entries of a chunk's index in the order in which they are written, all of shape [n].

    `offset` counts from the start of the chunk's uncompressed bytes to the opcode of the message.
    """

    channel_id: NDArray[np.uint16]
    log_time_ns: NDArray[np.uint64]
    offset: NDArray[np.uint64]

    def counts(self, where: NDArray[np.bool_] | None = None) -> dict[int, int]:
        """Messages by channel id, of all entries or of those picked."""
        return counts_of(self.channel_id if where is None else self.channel_id[where])


def parse_index(block: wire.Bytes) -> IndexEntries | None:
    """The entries of consecutive MessageIndex records; None where that is not what the bytes are."""
    ids: list[int] = []
    sizes: list[int] = []
    parts: list[memoryview] = []
    view = memoryview(block)
    at, end = 0, len(block)
    while at < end:
        if end - at < _INDEX_HEAD.size:
            return None
        opcode, length, channel_id, size = _INDEX_HEAD.unpack_from(block, at)
        if opcode != wire.MESSAGE_INDEX or length != size + 6 or size % 16 or at + 9 + length > end:
            return None
        ids.append(channel_id)
        sizes.append(size // 16)
        parts.append(view[at + 15 : at + 15 + size])
        at += 9 + int(length)
    pairs = np.frombuffer(b"".join(parts), dtype="<u8").reshape(-1, 2)
    of_channel = np.repeat(np.array(ids, dtype=np.uint16), np.array(sizes, dtype=np.int64))
    return IndexEntries(of_channel, pairs[:, 0], pairs[:, 1])


def counts_of(channel_id: NDArray[np.uint16]) -> dict[int, int]:
    """How often each channel id occurs."""
    if not len(channel_id):
        return {}
    counts = np.bincount(channel_id)
    return {int(number): int(counts[number]) for number in np.flatnonzero(counts)}


def sound_counts(entries: IndexEntries | None, uncompressed_size: int) -> dict[int, int] | None:
    """Messages by channel id as the index has them; None where it cannot be the index of so many bytes."""
    if entries is None or not len(entries.offset):
        return None
    places = np.sort(entries.offset, kind="stable")  # a run for each channel, which this kind makes use of
    if int(places[-1]) + 31 > uncompressed_size or (places[1:] == places[:-1]).any():
        return None
    return entries.counts()
