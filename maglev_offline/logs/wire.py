"""The records of MCAP, parsed from bytes that may not be trusted. Every failure is `Malformed`."""

import struct
from typing import NamedTuple

from mcap.records import Channel, Schema

MAGIC_LENGTH = 8

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(0x01, 0x09)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(0x09, 0x10)

HEAD = struct.Struct("<BQ")
"""What every record begins with: its opcode, and the length of what follows."""

DATA_END_LENGTH = HEAD.size + 4

LARGEST_DECLARATION = 2**24
"""Schema, channel and metadata records beyond this many bytes are refused."""

LONGEST_COMPRESSION_NAME = 32
CHUNK_HEAD_LENGTH = HEAD.size + 40 + LONGEST_COMPRESSION_NAME
"""So many bytes of a chunk record are enough to read its `ChunkHead`."""

Bytes = bytes | memoryview


class Malformed(ValueError):
    """These bytes are not the record that they should be."""


class ChunkHead(NamedTuple):
    """The fields of a chunk record before its data. `claimed_length` is what the record's head says, not checked."""

    claimed_length: int
    start_time_ns: int
    end_time_ns: int
    uncompressed_size: int
    crc: int
    compression: str
    data_start: int
    data_length: int

    @property
    def record_length(self) -> int:
        """Length of the whole record, by the length of its data."""
        return self.data_start + self.data_length

    @property
    def agrees(self) -> bool:
        """Whether the two lengths in the record agree."""
        return HEAD.size + self.claimed_length == self.record_length


class ChunkIndex(NamedTuple):
    """Where a chunk lies and which channels have messages in it, by the summary."""

    offset: int
    length: int
    index_length: int
    channel_ids: tuple[int, ...]
    compression: str
    compressed_size: int
    uncompressed_size: int


class Statistics(NamedTuple):
    """What the file says that it holds."""

    message_count: int
    channel_count: int
    chunk_count: int
    by_channel: dict[int, int]


class _Cursor:
    """Reads fields one after another; never beyond the end."""

    def __init__(self, body: Bytes) -> None:
        self.body, self.at = memoryview(body), 0

    def take(self, n: int) -> memoryview:
        end = self.at + n
        if end > len(self.body):
            raise Malformed("a field leaves its record")
        part = self.body[self.at : end]
        self.at = end
        return part

    def number(self, n: int) -> int:
        return int.from_bytes(self.take(n), "little")

    def text(self) -> str:
        try:
            return str(self.take(self.number(4)), "utf-8")
        except UnicodeDecodeError:
            raise Malformed("a text is not UTF-8") from None

    def texts(self) -> dict[str, str]:
        inner = _Cursor(self.take(self.number(4)))
        found: dict[str, str] = {}
        while inner.at < len(inner.body):
            name = inner.text()
            found[name] = inner.text()
        return found


def schema(body: Bytes) -> Schema:
    """A Schema record."""
    c = _Cursor(body)
    return Schema(id=c.number(2), name=c.text(), encoding=c.text(), data=bytes(c.take(c.number(4))))


def channel(body: Bytes) -> Channel:
    """A Channel record."""
    c = _Cursor(body)
    number, schema_id = c.number(2), c.number(2)
    return Channel(id=number, schema_id=schema_id, topic=c.text(), message_encoding=c.text(), metadata=c.texts())


def metadata(body: Bytes) -> tuple[str, dict[str, str]]:
    """Name and content of a Metadata record."""
    c = _Cursor(body)
    return c.text(), c.texts()


def attachment(start: Bytes, length: int) -> tuple[str, int]:
    """Name and size of an attachment, from the first bytes of its record of `length` bytes."""
    c = _Cursor(start)
    c.take(16)
    name = c.text()
    c.text()
    size = c.number(8)
    if c.at + size + 4 != length:
        raise Malformed("the size of an attachment does not fit its record")
    return name, size


def statistics(body: Bytes) -> Statistics:
    """A Statistics record."""
    c = _Cursor(body)
    messages, _, channels, _, _, chunks = (c.number(n) for n in (8, 2, 4, 4, 4, 4))
    c.take(16)
    inner = _Cursor(c.take(c.number(4)))
    by_channel: dict[int, int] = {}
    while inner.at < len(inner.body):
        number = inner.number(2)
        by_channel[number] = inner.number(8)
    return Statistics(messages, channels, chunks, by_channel)


def chunk_index(body: Bytes) -> ChunkIndex:
    """A ChunkIndex record."""
    c = _Cursor(body)
    c.take(16)
    offset, length, offsets_length = c.number(8), c.number(8), c.number(4)
    offsets = c.take(offsets_length)
    if offsets_length % 10:
        raise Malformed("the channels of a chunk index are cut off")
    channel_ids = tuple(number for number, _ in struct.iter_unpack("<HQ", offsets))
    index_length = c.number(8)
    return ChunkIndex(offset, length, index_length, channel_ids, c.text(), c.number(8), c.number(8))


def chunk_head(record: Bytes) -> ChunkHead:
    """The head of a chunk record, from at least its first `CHUNK_HEAD_LENGTH` bytes (fewer at the file's end)."""
    c = _Cursor(record)
    opcode, claimed_length = c.number(1), c.number(8)
    if opcode != CHUNK:
        raise Malformed("there is no chunk here")
    start, end, size, crc, name_length = (c.number(n) for n in (8, 8, 8, 4, 4))
    if name_length > LONGEST_COMPRESSION_NAME:
        raise Malformed("the compression has no sensible name")
    try:
        name = str(c.take(name_length), "ascii")
    except UnicodeDecodeError:
        raise Malformed("the compression has no sensible name") from None
    length = c.number(8)
    return ChunkHead(claimed_length, start, end, size, crc, name, c.at, length)
