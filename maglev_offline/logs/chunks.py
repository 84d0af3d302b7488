"""One span of a log at a time: read, checked against what it claims, decompressed, its messages found."""

from collections.abc import Mapping
from typing import TypeVar

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import zstandard
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from maglev_offline.logs import messages, wire
from maglev_offline.logs.checksum import crc32
from maglev_offline.logs.message_index import IndexEntries, counts_of, parse_index, sound_counts
from maglev_offline.logs.source import Source
from maglev_offline.logs.structure import ChunkSpan, Damage, Loaded, LooseSpan, MessageTable, Span

LARGEST_CHUNK_BYTES = 2**31
"""A chunk that claims to be larger is refused before memory is asked for it; recorders write a few MiB."""

_MOST_BYTES_PER_BYTE = {"": 2**31, "zstd": 2**17, "lz4": 2**8}
"""No more can come out of one compressed byte: zstd has blocks of 128 KiB in 4 bytes, lz4 runs of 255 in one.
What is not compressed is not allocated, so there is no bound to it."""

_LOOSE_OPCODES = frozenset({wire.MESSAGE, wire.SCHEMA, wire.CHANNEL})

_Declared = TypeVar("_Declared", Schema, Channel)


class _Unusable(Exception):
    """The chunk cannot be used; carries the code and the detail of the damage."""

    def __init__(self, code: str, detail: str) -> None:
        super().__init__(detail)
        self.code, self.detail = code, detail


def load_span(source: Source, span: Span, channels: Mapping[int, Channel] | None = None) -> Loaded:
    """Read one span and find its messages. Nothing that fails a check is used; it is told as damage instead.

    Parameters
    ----------
    channels: those known of the whole file. Messages of a channel that is neither among them nor declared in the span
        are left out, and told. Without it all messages are given.

    Raises
    ------
    LogError: the disk or the network fails.
    """
    if isinstance(span, LooseSpan):
        data = np.frombuffer(source.read_at(span.offset, span.length), dtype=np.uint8)
        found = messages.from_records(data, _LOOSE_OPCODES)
        return _loaded(span, data, found, channels, _rest(span, data, found, None))
    block = b""
    head: wire.ChunkHead | None = None
    try:
        if span.length > LARGEST_CHUNK_BYTES:
            raise _Unusable("chunk_too_large", f"the chunk takes {span.length:,} bytes of the file")
        index_length = span.index_length if span.index_length <= LARGEST_CHUNK_BYTES else 0
        raw = source.read_at(span.offset, span.length + index_length)
        record, block = memoryview(raw)[: span.length], raw[span.length :]
        head = _checked_head(record)
        data = _content(record, head)
    except _Unusable as bad:
        lost = sound_counts(parse_index(block), head.uncompressed_size if head else 2**63)
        return _nothing(Damage(bad.code, span.offset, span.length, lost, bad.detail))
    entries = parse_index(block)
    if head.crc and crc32(data.data) != head.crc:
        lost = sound_counts(entries, len(data))
        if lost is None:
            found = messages.from_records(data)
            lost = counts_of(found.messages.channel_id) if found.stop == len(data) else None
        detail = "the check sum of the chunk does not match its content"
        return _nothing(Damage("chunk_crc_mismatch", span.offset, span.length, lost, detail))
    return _with_messages(span, head, data, entries, channels)


def _with_messages(
    span: ChunkSpan,
    head: wire.ChunkHead,
    data: NDArray[np.uint8],
    entries: IndexEntries | None,
    channels: Mapping[int, Channel] | None,
) -> Loaded:
    damages: list[Damage] = []
    if not head.agrees or head.record_length != span.length:
        detail = f"the record claims {head.claimed_length:,} bytes, its content tells {head.record_length - 9:,}"
        damages.append(Damage("record_length_mismatch", span.offset, 9, {}, detail))
    found = messages.from_index(data, entries) if entries is not None and span.index_length else None
    if found is None:
        found = messages.from_records(data)
        if span.index_length:
            detail = "the index of the chunk does not fit its messages; the messages themselves were used"
            damages.append(Damage("message_index_mismatch", span.index_offset, span.index_length, {}, detail))
    return _loaded(span, data, found, channels, [*damages, *_rest(span, data, found, entries)])


def _checked_head(record: memoryview) -> wire.ChunkHead:
    try:
        head = wire.chunk_head(record[: wire.CHUNK_HEAD_LENGTH])
    except wire.Malformed as error:
        raise _Unusable("chunk_unreadable", str(error)) from None
    if head.record_length > len(record):
        raise _Unusable("chunk_unreadable", f"{head.record_length:,} bytes of chunk do not fit in {len(record):,}")
    claimed, most = head.uncompressed_size, _MOST_BYTES_PER_BYTE.get(head.compression)
    if most is None:
        raise _Unusable("unknown_compression", f"the chunk is compressed with {head.compression!r}")
    if claimed > LARGEST_CHUNK_BYTES or claimed > most * head.data_length:
        raise _Unusable("chunk_too_large", f"{head.data_length:,} bytes of chunk claim to hold {claimed:,} bytes")
    return head


def _content(record: memoryview, head: wire.ChunkHead) -> NDArray[np.uint8]:
    stored = record[head.data_start : head.record_length]
    claimed = head.uncompressed_size
    try:
        if head.compression == "zstd":
            data: bytes | memoryview = _zstd(stored, claimed)
        elif head.compression == "lz4":
            data = _lz4(stored, claimed)
        else:
            data = stored
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError, OverflowError, MemoryError) as error:
        # RuntimeError is what lz4 raises.
        raise _Unusable("chunk_unreadable", f"it cannot be decompressed ({error})") from None
    if len(data) != claimed:
        told = f"{len(data):,} bytes" if len(data) <= claimed else "more"
        raise _Unusable("chunk_size_mismatch", f"the chunk claims to hold {claimed:,} bytes and holds {told}")
    return np.frombuffer(data, dtype=np.uint8)


def _zstd(stored: memoryview, claimed: int) -> bytes:
    decompressor = zstandard.ZstdDecompressor()
    if claimed and zstandard.frame_content_size(stored) == claimed:
        return bytes(decompressor.decompress(stored, max_output_size=claimed))
    # The frame does not tell its size, or there are several. One byte more than claimed is enough to know.
    with decompressor.stream_reader(stored, read_across_frames=True) as reader:
        return bytes(reader.read(claimed + 1))


def _lz4(stored: memoryview, claimed: int) -> bytes:
    if claimed and lz4.frame.get_frame_info(stored)["content_size"] == claimed:
        return bytes(lz4.frame.decompress(stored))
    decompressor = lz4.frame.LZ4FrameDecompressor()
    data = decompressor.decompress(stored, max_length=claimed + 1)
    if not decompressor.eof and len(data) <= claimed:
        raise EOFError("the lz4 frame has no end")
    return bytes(data)


def _rest(span: Span, data: NDArray[np.uint8], found: messages.Found, entries: IndexEntries | None) -> list[Damage]:
    """What lies behind the last record that could be read."""
    if found.stop == len(data):
        return []
    lost = None
    if entries is not None and sound_counts(entries, len(data)) is not None:
        lost = entries.counts(entries.offset >= found.stop)
    length = len(data) - found.stop
    detail = f"no record begins at byte {found.stop:,} of the {len(data):,} in the span; the {length:,} behind are lost"
    return [Damage("records_unreadable", span.offset, span.length, lost, detail)]


def _nothing(damage: Damage) -> Loaded:
    return Loaded(np.empty(0, dtype=np.uint8), messages.empty_table(), {}, {}, {}, (damage,))


def _loaded(
    span: Span,
    data: NDArray[np.uint8],
    found: messages.Found,
    known: Mapping[int, Channel] | None,
    damages: list[Damage],
) -> Loaded:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for opcode, offset, length in found.others:
        damages += declare(bytes(data[offset : offset + length]), opcode, schemas, channels, (span.offset, span.length))
    table = found.messages
    counts = counts_of(table.channel_id)
    if known is not None:
        damages += conflicts(channels, known, (span.offset, span.length))
        declared = known.keys() | channels.keys()
        unknown = {number: n for number, n in counts.items() if number not in declared}
        if unknown:
            detail = f"messages of channels that are declared nowhere: {', '.join(map(str, unknown))}"
            damages.append(Damage("unknown_channel", span.offset, span.length, unknown, detail))
            keep = ~np.isin(table.channel_id, list(unknown))
            table = MessageTable(*(column[keep] for column in vars(table).values()))
            counts = {number: n for number, n in counts.items() if number in declared}
    return Loaded(data, table, counts, schemas, channels, tuple(damages))


def declare(
    record: bytes, opcode: int, schemas: dict[int, Schema], channels: dict[int, Channel], place: tuple[int, int]
) -> list[Damage]:
    """Add a whole Schema or Channel record to those known; other records are passed over. The first of an id counts.

    Returns what is wrong with it: too large, not readable, or unlike an earlier one of the same id.
    """
    if opcode not in (wire.SCHEMA, wire.CHANNEL):
        return []
    if len(record) > wire.LARGEST_DECLARATION:
        return [Damage("record_too_large", *place, {}, f"a declaration of {len(record):,} bytes is not read")]
    try:
        if opcode == wire.SCHEMA:
            schema = wire.schema(record[9:])
            # The specification has readers pass over a schema with id 0, which means "no schema".
            return _add(schemas, schema, place) if schema.id else []
        return _add(channels, wire.channel(record[9:]), place)
    except wire.Malformed as error:
        return [Damage("declaration_unreadable", *place, {}, f"a schema or channel cannot be read: {error}")]


def _add(known: dict[int, _Declared], new: _Declared, place: tuple[int, int]) -> list[Damage]:
    if known.setdefault(new.id, new) == new:
        return []
    return [_conflict(known[new.id], place)]


def conflicts(new: Mapping[int, _Declared], known: Mapping[int, _Declared], place: tuple[int, int]) -> list[Damage]:
    """Declarations that differ from those known under the same id."""
    return [_conflict(known[k], place) for k, declared in new.items() if k in known and known[k] != declared]


def _conflict(first: Schema | Channel, place: tuple[int, int]) -> Damage:
    name = f"channel {first.id} ({first.topic})" if isinstance(first, Channel) else f"schema {first.id} ({first.name})"
    return Damage("declaration_conflict", *place, {}, f"{name} is declared again with another content")
