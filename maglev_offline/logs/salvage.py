"""Where reading can go on behind a stretch of a file that is no sequence of records."""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs import wire
from maglev_offline.logs.source import Source
from maglev_offline.logs.window import BODY_LENGTHS, Window, measure

_FIRST_SEARCH_BYTES, _SEARCH_BYTES = 2**16, 2**22
"""So much of the file is searched at first and at a time later: mostly the next record is near."""

_CHAIN = 4
"""So many records must follow each other where the first alone would prove little."""

IN_CHUNKED: tuple[int, ...] = (
    wire.CHUNK,
    wire.MESSAGE_INDEX,
    wire.METADATA,
    wire.ATTACHMENT,
    wire.DATA_END,
    wire.STATISTICS,
    wire.CHUNK_INDEX,
    wire.FOOTER,
)
"""What to look for in a file with chunks. Not messages: those in a broken chunk would be taken for such outside."""

IN_LOOSE = (*IN_CHUNKED, wire.SCHEMA, wire.CHANNEL, wire.MESSAGE)
"""What to look for in a file without chunks."""

OF_CHUNKS = (wire.CHUNK, wire.MESSAGE_INDEX, wire.CHUNK_INDEX)
"""What only a file with chunks has."""

_ALONE_SURE = (wire.CHUNK, wire.FOOTER)
"""Records that say enough in their heads to be known for what they are."""

COMPRESSIONS = ("", "zstd", "lz4")


def next_record(source: Source, start: int, end: int, opcodes: Collection[int], channels: Collection[int]) -> int:
    """Offset of the first record at or behind `start` that is surely one; `end` if there is none.

    Parameters
    ----------
    opcodes: what it may be.
    channels: ids that a message may have; with none, any.
    """
    window = Window(source)
    # Shortest and longest body by opcode; an opcode that is not looked for has none that fits.
    shortest, longest = np.full(256, 2**40), np.full(256, -1)
    for opcode in opcodes:
        shortest[opcode], longest[opcode] = BODY_LENGTHS[opcode]
    at, step = start, _FIRST_SEARCH_BYTES
    while at < end:
        data = np.frombuffer(source.read_at(at, min(step + 8, end - at)), dtype=np.uint8)
        for candidate in _candidates(data, shortest, longest, end - at).tolist():
            if _is_record(window, at + candidate, end, channels):
                return at + int(candidate)
        at, step = at + step, _SEARCH_BYTES
    return end


def _candidates(
    data: NDArray[np.uint8], shortest: NDArray[np.int64], longest: NDArray[np.int64], room: int
) -> NDArray[np.intp]:
    """Offsets of a wanted opcode with a length that fits, which is below 4 GiB for every sensible record."""
    if len(data) < 9:
        return np.empty(0, dtype=np.intp)
    high = (data[5:-3] | data[6:-2] | data[7:-1] | data[8:]) == 0
    found = np.flatnonzero((longest[data[:-8]] >= 0) & high)
    length = sum(data[found + 1 + k].astype(np.int64) << (8 * k) for k in range(4))
    opcode = data[found]
    return found[(length >= shortest[opcode]) & (length <= longest[opcode]) & (found + 9 + length <= room)]


def _is_record(window: Window, at: int, end: int, channels: Collection[int]) -> bool:
    for _ in range(_CHAIN):
        length = measure(window, at, end, strict=True)
        if length is None or not _sensible(window, at, channels):
            return False
        if window.get(at, 1)[0] in _ALONE_SURE:
            return True
        at += length
        if at == end:
            break
    return True


def _sensible(window: Window, at: int, channels: Collection[int]) -> bool:
    opcode = window.get(at, 1)[0]
    if opcode == wire.CHUNK:
        head = wire.chunk_head(window.get(at, wire.CHUNK_HEAD_LENGTH))
        return head.compression in COMPRESSIONS and head.start_time_ns <= head.end_time_ns
    if opcode == wire.MESSAGE and channels:
        return int.from_bytes(window.get(at + 9, 2), "little") in channels
    return True
