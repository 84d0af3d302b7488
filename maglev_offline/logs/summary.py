"""The summary section at the end of a log, and whether it holds."""

from dataclasses import dataclass, field

from mcap.records import Channel, Schema

from maglev_offline.logs import wire
from maglev_offline.logs.checksum import crc32
from maglev_offline.logs.chunks import declare
from maglev_offline.logs.source import MAGIC, Source
from maglev_offline.logs.window import Window

_LARGEST_SUMMARY = 2**28
"""A summary that claims more bytes is not read; one of 5,000 chunks with 60 channels takes 4 MB."""

_FOOTER_LENGTH = 29
_REMOTE_LOOKS = 32


@dataclass
class Summary:
    """What the summary section at byte `start` tells. `proven` says that its check sum was there and holds."""

    start: int
    proven: bool
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[wire.ChunkIndex] = field(default_factory=list)
    statistics: wire.Statistics | None = None


def read_summary(source: Source, end: int | None = None, start: int | None = None) -> Summary | None:
    """Read the summary of a log; None where there is none or it is damaged.

    Parameters
    ----------
    end: where the log ends, if not with the file.
    start: where the summary begins, if not where the footer says, as where bytes before it are gone. Then only a
        check sum can say that this is it, and without one it is not used.
    """
    footer_at = (source.size if end is None else end) - _FOOTER_LENGTH - len(MAGIC)
    if footer_at < len(MAGIC):
        return None
    footer = source.read_at(footer_at, _FOOTER_LENGTH + len(MAGIC))
    opcode, length = wire.HEAD.unpack_from(footer)
    if opcode != wire.FOOTER or length != 20 or footer[_FOOTER_LENGTH:] != MAGIC:
        return None
    told_start = int.from_bytes(footer[9:17], "little")
    crc = int.from_bytes(footer[25:29], "little")
    if start is None:
        start = told_start
    elif not told_start or not crc:
        return None
    if not len(MAGIC) <= start < footer_at or footer_at - start > _LARGEST_SUMMARY:
        return None
    section = source.read_at(start, footer_at - start)
    if crc and crc32(footer[:25], crc32(section)) != crc:
        return None
    summary = Summary(start, bool(crc))
    if not _parse(section, summary):
        return None
    told = summary.statistics
    return summary if told is None or sum(told.by_channel.values()) == told.message_count else None


def _parse(section: bytes, summary: Summary) -> bool:
    at = 0
    while at < len(section):
        if len(section) - at < 9:
            return False
        opcode, length = wire.HEAD.unpack_from(section, at)
        end = at + 9 + length
        if end > len(section):
            return False
        try:
            if opcode == wire.CHUNK_INDEX:
                summary.chunks.append(wire.chunk_index(section[at + 9 : end]))
            elif opcode == wire.STATISTICS:
                summary.statistics = wire.statistics(section[at + 9 : end])
            elif declare(section[at:end], opcode, summary.schemas, summary.channels, (summary.start, len(section))):
                return False
        except wire.Malformed:
            return False
        at = end
    return True


def fits(source: Source, summary: Summary) -> bool:
    """Whether chunks lie where the summary has them; a single one that is damaged is no reason to doubt it."""
    summary.chunks.sort(key=lambda index: index.offset)
    at = len(MAGIC)
    for index in summary.chunks:
        if index.offset < at or index.offset + index.length + index.index_length > summary.start:
            return False
        at = index.offset + index.length + index.index_length
    told = summary.statistics
    if not summary.chunks:
        return True
    if told is not None and told.chunk_count != len(summary.chunks):
        return False
    window = Window(source)
    looked = summary.chunks if source.local else summary.chunks[:: len(summary.chunks) // _REMOTE_LOOKS + 1]
    agree = [_chunk_lies_there(window, index) for index in [*looked, *summary.chunks[-1:]]]
    # Where bytes were lost or added, no chunk behind that place is where it should be, the last one least of all.
    return all(agree) or (summary.proven and agree[-1])


def _chunk_lies_there(window: Window, index: wire.ChunkIndex) -> bool:
    try:
        head = wire.chunk_head(window.get(index.offset, wire.CHUNK_HEAD_LENGTH))
    except wire.Malformed:
        return False
    return head.record_length == index.length and head.data_length == index.compressed_size
