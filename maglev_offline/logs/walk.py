"""From record to record through a file that may be damaged; what is no record is skipped and told."""

from collections import Counter
from collections.abc import Callable

import numpy as np
from mcap.records import Channel, Schema

from maglev_offline.logs import messages, wire
from maglev_offline.logs.chunks import declare
from maglev_offline.logs.message_index import counts_of
from maglev_offline.logs.salvage import COMPRESSIONS, IN_CHUNKED, IN_LOOSE, OF_CHUNKS, next_record
from maglev_offline.logs.source import MAGIC, Source
from maglev_offline.logs.structure import ChunkSpan, Damage, LooseSpan, Span
from maglev_offline.logs.summary import Summary
from maglev_offline.logs.window import Window, measure

LOOSE_SPAN_BYTES = 2**22
"""Messages outside chunks are handled in spans of about so many bytes."""

MOST_HOLES = 10_000
"""After so many the rest of the file is given up; no accident makes more, and each costs time."""

MOST_METADATA_BYTES = 2**26
"""Metadata beyond this much in all is not kept."""

_SHORT_RUN_BYTES = 2**16
"""At first only so many are read: mostly it is a few declarations and no messages."""

_RUN = frozenset({wire.MESSAGE, wire.SCHEMA, wire.CHANNEL})
_DECLARATIONS = (wire.SCHEMA, wire.CHANNEL)
_ATTACHMENT_HEAD = 2**16


class Walk:
    """What was met so far.

    `indexed` has the channels in the index of each chunk, by the chunk's offset; `data_end` offset and check sum of the
    DataEnd record; `end_of_file` where the magic bytes behind the footer end, `has_summary` whether the
    footer says that there is a summary.
    """

    def __init__(self, source: Source, *, by_summary: bool) -> None:
        self.source, self.by_summary = source, by_summary
        self.spans: list[Span] = []
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: list[tuple[str, int]] = []
        self.compressions: set[str] = set()
        self.claimed: dict[int, int] | None = None
        self.damages: list[Damage] = []
        self.indexed: dict[int, set[int]] = {}
        self.loose_counts: Counter[int] = Counter()
        self.data_end: tuple[int, int] | None = None
        self._window = Window(source)
        self.end_of_file: int | None = None
        self.has_summary = False
        self._last_message: tuple[int, int] | None = None
        self._chunks_seen = False
        self._loose_seen = False
        self._metadata_bytes = 0
        self._holes = 0

    def whole_file(self) -> None:
        """Walk all records, and tell how the file ends."""
        size = self.source.size
        self.region(len(MAGIC), size, chunked=None)
        if self.end_of_file is None:
            if not any(damage.code == "truncated" for damage in self.damages):
                self.damages.append(self._cut("no_footer", size, "the file ends without a footer"))
        elif self.end_of_file < size:
            self._tell_trailing(self.end_of_file)

    def region(self, start: int, end: int, *, chunked: bool | None) -> None:
        """Walk the records from `start` to `end`; `chunked` None: not known yet."""
        at = start
        while at < end and self.end_of_file is None:
            length = measure(self._window, at, end)
            if length is not None:
                length = self._take(at, length, end)
            at = at + length if length is not None else self._skip(at, end, chunked)

    def declare(self, summary: Summary) -> None:
        """Add what a summary declares and claims."""
        self.schemas = summary.schemas | self.schemas
        self.channels = summary.channels | self.channels
        self.claimed = summary.statistics.by_channel if summary.statistics else None

    def add_chunk(self, index: wire.ChunkIndex) -> None:
        """Add a chunk that the summary tells of."""
        self.spans.append(ChunkSpan(index.offset, index.length, index.offset + index.length, index.index_length))
        self.compressions.add(index.compression or "none")
        self._chunks_seen = True
        if index.channel_ids:
            self.indexed[index.offset] = set(index.channel_ids)

    def _take(self, at: int, length: int, end: int) -> int | None:
        """Take in the record at `at`; how many bytes were used up, None where it turns out to be no record."""
        opcode = self._window.get(at, 1)[0]
        if self.data_end is not None and opcode in _DECLARATIONS:
            # The summary begins here; it has a check sum of its own, and is read as a whole or not at all.
            return length
        if opcode in _RUN:
            return self._take_run(at, length, end)
        if opcode == wire.FOOTER:
            self.end_of_file = at + length + len(MAGIC)
            self.has_summary = self._window.get(at + 9, 8) != bytes(8)
            return length
        taker = self._takers.get(opcode)
        try:
            return taker(self, at, length) if taker else length
        except wire.Malformed:
            return None

    def _take_chunk(self, at: int, length: int) -> int:
        head = wire.chunk_head(self._window.get(at, wire.CHUNK_HEAD_LENGTH))
        self.spans.append(ChunkSpan(at, length, at + length, 0))
        self.compressions.add(head.compression or "none")
        self._chunks_seen = True
        return length

    def _take_index(self, at: int, length: int) -> int:
        last = self.spans[-1] if self.spans else None
        if isinstance(last, ChunkSpan) and last.index_offset + last.index_length == at:
            self.spans[-1] = ChunkSpan(last.offset, last.length, last.index_offset, last.index_length + length)
            channel_id = int.from_bytes(self._window.get(at + 9, 2), "little")
            self.indexed.setdefault(last.offset, set()).add(channel_id)
        return length

    def _take_metadata(self, at: int, length: int) -> int:
        self._metadata_bytes += length
        if length > wire.LARGEST_DECLARATION or self._metadata_bytes > MOST_METADATA_BYTES:
            detail = f"a metadata record of {length:,} bytes is not read; {MOST_METADATA_BYTES:,} are kept in all"
            self.damages.append(Damage("record_too_large", at, length, {}, detail))
            return length
        name, content = wire.metadata(self.source.read_at(at + 9, length - 9))
        self.metadata.setdefault(name, content)
        return length

    def _take_attachment(self, at: int, length: int) -> int:
        self.attachments.append(wire.attachment(self._window.get(at + 9, _ATTACHMENT_HEAD), length - 9))
        return length

    def _take_data_end(self, at: int, length: int) -> int:
        self.data_end = (at, int.from_bytes(self._window.get(at + 9, 4), "little"))
        return length

    _takers: dict[int, Callable[["Walk", int, int], int]] = {  # noqa: RUF012
        wire.CHUNK: _take_chunk,
        wire.MESSAGE_INDEX: _take_index,
        wire.METADATA: _take_metadata,
        wire.ATTACHMENT: _take_attachment,
        wire.DATA_END: _take_data_end,
    }

    def _take_run(self, at: int, length: int, end: int) -> int | None:
        """Take in messages, schemas and channels that follow each other outside chunks, up to a span full."""
        if length > LOOSE_SPAN_BYTES:
            return self._take_long(at, length)
        for most in (_SHORT_RUN_BYTES, LOOSE_SPAN_BYTES):
            data = np.frombuffer(self.source.read_at(at, min(most, end - at)), dtype=np.uint8)
            found = messages.from_records(data, _RUN)
            if at + len(data) == end or self._window.get(at + found.stop, 1)[0] not in _RUN:
                break
        if not found.stop:
            return None
        self._loose_seen = True
        place = (at, found.stop)
        for opcode, offset, size in found.others:
            self.damages += declare(bytes(data[offset : offset + size]), opcode, self.schemas, self.channels, place)
        if len(found.messages):
            self.spans.append(LooseSpan(at, found.stop))
            self.loose_counts.update(counts_of(found.messages.channel_id))
            start = int(found.messages.start[-1]) - messages.MESSAGE_HEAD
            self._last_message = (at + start, int(found.messages.channel_id[-1]))
        return found.stop

    def _take_long(self, at: int, length: int) -> int | None:
        head = self._window.get(at, messages.MESSAGE_HEAD)
        if head[0] == wire.MESSAGE:
            channel_id = int.from_bytes(head[9:11], "little")
            self.spans.append(LooseSpan(at, length))
            self.loose_counts[channel_id] += 1
            self._last_message = (at, channel_id)
        elif length <= wire.LARGEST_DECLARATION:
            record = self.source.read_at(at, length)
            self.damages += declare(record, head[0], self.schemas, self.channels, (at, length))
        else:
            detail = f"a declaration of {length:,} bytes is not read"
            self.damages.append(Damage("record_too_large", at, length, {}, detail))
        return length

    def _skip(self, at: int, end: int, chunked: bool | None) -> int:
        """Tell of what is no record at `at`, and return where reading goes on."""
        doubtful = self._start_of_message_before(at)
        opcodes = self._salvageable(at, end) if chunked is None else IN_CHUNKED
        found = end
        if self._holes < MOST_HOLES:
            channels = self.channels.keys() if opcodes is IN_LOOSE else ()
            found = next_record(self.source, doubtful + 1, end, opcodes, channels)
        self._holes += 1
        cut_off = found == end == self.source.size
        if doubtful < at and not (cut_off and self._window.get(at, 1) != b"\0"):
            self._take_back(doubtful)
            at = doubtful
        if cut_off:
            self.damages.append(self._cut("truncated", at, f"the last {end - at:,} bytes are no whole record"))
        else:
            self.damages.append(Damage("bytes_unreadable", at, found - at, None, f"{found - at:,} bytes, no record"))
        return found

    def _salvageable(self, at: int, end: int) -> tuple[int, ...]:
        """What to look for behind the nonsense at `at`: messages only where it is sure that they lie outside chunks."""
        if self._chunks_seen or self._is_cut_chunk(at):
            return IN_CHUNKED
        if self._loose_seen:
            return IN_LOOSE
        if next_record(self.source, at + 1, end, OF_CHUNKS, ()) < end:
            return IN_CHUNKED
        # The end of the file would tell of chunks.
        whole = self.source.read_at(self.source.size - len(MAGIC), len(MAGIC)) == MAGIC
        return IN_LOOSE if whole else IN_CHUNKED

    def _is_cut_chunk(self, at: int) -> bool:
        try:
            return wire.chunk_head(self._window.get(at, wire.CHUNK_HEAD_LENGTH)).compression in COMPRESSIONS
        except wire.Malformed:
            return False

    def _start_of_message_before(self, at: int) -> int:
        """Where the message outside chunks begins that ends at `at`; `at` where there is none.

        It may well have a part in the nonsense behind it: its length may be wrong, or a part of it may be missing, and
        no check sum and no record behind it says that it is whole.
        """
        last = self.spans[-1] if self.spans else None
        if self._last_message is None or not isinstance(last, LooseSpan) or last.offset + last.length != at:
            return at
        return self._last_message[0]

    def _take_back(self, start: int) -> None:
        """Forget the last message outside chunks, which begins at `start`."""
        last = self.spans.pop()
        if start > last.offset:
            self.spans.append(LooseSpan(last.offset, start - last.offset))
        if self._last_message is not None:
            self.loose_counts[self._last_message[1]] -= 1
        self._last_message = None

    def _cut(self, code: str, at: int, detail: str) -> Damage:
        # Behind the end of the data section there are no messages to lose.
        return Damage(code, at, self.source.size - at, {} if self.data_end is not None else None, detail)

    def _tell_trailing(self, at: int) -> None:
        size = self.source.size
        another = self.source.read_at(at, len(MAGIC)) == MAGIC
        detail = "another MCAP file follows" if another else f"{size - at:,} bytes follow the end of the log"
        self.damages.append(Damage("trailing_bytes", at, size - at, None if another else {}, detail))
