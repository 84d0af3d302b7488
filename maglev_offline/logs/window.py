"""Looking at the heads of records anywhere in a file, without reading what lies between them."""

from maglev_offline.logs import wire
from maglev_offline.logs.source import MAGIC, Source

_LOCAL_BYTES, _REMOTE_BYTES = 2**16, 2**20

_HEAD = wire.HEAD.size

_ANY = 2**62

BODY_LENGTHS = {
    wire.HEADER: (8, _ANY),
    wire.FOOTER: (20, 20),
    wire.SCHEMA: (14, _ANY),
    wire.CHANNEL: (16, _ANY),
    wire.MESSAGE: (22, _ANY),
    wire.CHUNK: (40, _ANY),
    wire.MESSAGE_INDEX: (6, 6 + 2**32),
    wire.CHUNK_INDEX: (64, _ANY),
    wire.ATTACHMENT: (32, _ANY),
    wire.ATTACHMENT_INDEX: (48, _ANY),
    wire.STATISTICS: (46, _ANY),
    wire.METADATA: (8, _ANY),
    wire.METADATA_INDEX: (20, _ANY),
    wire.SUMMARY_OFFSET: (17, _ANY),
    wire.DATA_END: (4, 4),
}
"""Fewest and most bytes behind the head of a record, by opcode."""


class Window:
    """A piece of the file that is kept, so that many small reads close together are one."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._step = _LOCAL_BYTES if source.local else _REMOTE_BYTES
        self._start, self._kept = 0, b""

    def get(self, offset: int, length: int) -> bytes:
        """`length` bytes at `offset`, fewer at the end of the file; meant for small lengths."""
        if not self._start <= offset or offset + length > self._start + len(self._kept):
            self._start, self._kept = offset, self.source.read_at(offset, max(length, self._step))
        first = offset - self._start
        return self._kept[first : first + length]


def measure(window: Window, at: int, end: int, *, strict: bool = False) -> int | None:
    """Length of the whole record at `at`, its head included; None where no record that fits before `end` begins.

    The head is held against what its opcode demands. A chunk whose own length is wrong is measured by the length of
    its data if a record follows there, unless `strict`; an opcode that this version of MCAP does not have, by the
    record behind it.
    """
    head = window.get(at, _HEAD)
    if len(head) < _HEAD or at + _HEAD > end:
        return None
    opcode, length = wire.HEAD.unpack(head)
    if opcode == wire.CHUNK:
        return _measure_chunk(window, at, end, strict)
    if opcode == 0 or at + _HEAD + length > end:
        return None
    whole = _HEAD + int(length)
    if opcode not in BODY_LENGTHS:
        return whole if not strict and _a_record_may_begin(window, at + whole, end) else None
    shortest, longest = BODY_LENGTHS[opcode]
    fits = bool(shortest <= length <= longest)
    if opcode == wire.FOOTER:
        fits = fits and window.get(at + whole, len(MAGIC)) == MAGIC
    elif opcode == wire.MESSAGE_INDEX:
        size = int.from_bytes(window.get(at + _HEAD + 2, 4), "little")
        fits = fits and length == size + 6 and size % 16 == 0
    return whole if fits else None


def _measure_chunk(window: Window, at: int, end: int, strict: bool) -> int | None:
    try:
        head = wire.chunk_head(window.get(at, wire.CHUNK_HEAD_LENGTH))
    except wire.Malformed:
        return None
    if at + head.record_length > end:
        return None
    if head.agrees or (not strict and _a_record_may_begin(window, at + head.record_length, end)):
        return head.record_length
    return None


def _a_record_may_begin(window: Window, at: int, end: int) -> bool:
    head = window.get(at, _HEAD)
    if len(head) < _HEAD or at + _HEAD > end:
        return False
    opcode, length = wire.HEAD.unpack(head)
    return bool(wire.HEADER <= opcode <= wire.DATA_END and at + _HEAD + length <= end)
