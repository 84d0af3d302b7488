"""The structure of a log: from its summary where that holds, from its records where not, around what is damaged."""

from collections.abc import Iterable

from maglev_offline.logs import wire
from maglev_offline.logs.checksum import crc32
from maglev_offline.logs.chunks import conflicts, load_span
from maglev_offline.logs.counts import count_messages
from maglev_offline.logs.source import MAGIC, Source
from maglev_offline.logs.structure import ChunkSpan, Damage, LooseSpan, Structure
from maglev_offline.logs.summary import Summary, fits, read_summary
from maglev_offline.logs.walk import Walk

__all__ = ["count_messages", "read_structure"]

_CRC_BYTES = 2**22


def read_structure(source: Source) -> Structure:
    """Find out where the chunks, messages, channels and metadata of a log lie, and what of it is damaged.

    Chunks are not read where a summary tells of them: what is wrong within one is found by `load_span`.

    Raises
    ------
    LogError: the disk or the network fails.
    """
    summary = read_summary(source)
    walk = _by_summary(source, summary) if summary is not None and fits(source, summary) else None
    if walk is None:
        walk = _by_records(source, summary)
    _check_data_crc(source, walk)
    _learn_from_chunks(source, walk)
    for channel in walk.channels.values():
        if channel.schema_id and channel.schema_id not in walk.schemas:
            detail = f"channel {channel.id} ({channel.topic}) names schema {channel.schema_id}"
            walk.damages.append(Damage("missing_schema", 0, 0, {}, detail))
    return Structure(
        spans=tuple(sorted(walk.spans, key=lambda span: span.offset)),
        schemas=dict(sorted(walk.schemas.items())),
        channels=dict(sorted(walk.channels.items())),
        metadata=walk.metadata,
        attachments=tuple(walk.attachments),
        compressions=tuple(sorted(walk.compressions)),
        claimed=walk.claimed,
        damages=tuple(sorted(walk.damages, key=lambda damage: (damage.offset, damage.code))),
        whole=summary is not None and walk.by_summary,
    )


def _by_summary(source: Source, summary: Summary) -> Walk | None:
    """Take the chunks from the summary and walk what lies between them; None where the two do not agree."""
    walk = Walk(source, by_summary=True)
    walk.declare(summary)
    # A writer may leave the chunk indexes out; then walking shows whether there are chunks.
    chunked = True if summary.chunks else None
    at = len(MAGIC)
    for index in summary.chunks:
        walk.region(at, index.offset, chunked=chunked)
        walk.add_chunk(index)
        at = index.offset + index.length + index.index_length
    walk.region(at, summary.start, chunked=chunked)
    if not summary.proven and any(damage.code in ("bytes_unreadable", "truncated") for damage in walk.damages):
        return None
    return walk


def _by_records(source: Source, summary: Summary | None) -> Walk:
    walk = Walk(source, by_summary=False)
    if summary is not None:
        # Where the chunks lie does not hold, what is declared does.
        walk.declare(summary)
    walk.whole_file()
    if walk.end_of_file is None:
        return walk
    start = walk.data_end[0] + wire.DATA_END_LENGTH if walk.data_end is not None else walk.end_of_file
    if summary is None:
        # It may lie before trailing bytes, or elsewhere than the footer says because bytes before it are gone.
        found = read_summary(source, walk.end_of_file) or read_summary(source, walk.end_of_file, start)
        if found is not None:
            walk.declare(found)
    if walk.has_summary and walk.end_of_file == source.size:
        detail = "the summary is damaged or does not fit the file"
        walk.damages.append(Damage("summary_unusable", start, source.size - start, {}, detail))
    return walk


def _check_data_crc(source: Source, walk: Walk) -> None:
    """Drop the messages outside chunks where the check sum over the data section says that they are damaged.

    Chunks have check sums of their own, so a file without such messages need not be read for this.
    """
    loose = [span for span in walk.spans if isinstance(span, LooseSpan)]
    if not loose or walk.data_end is None or not walk.data_end[1]:
        return
    end, stored = walk.data_end
    crc = 0
    for at in range(0, end, _CRC_BYTES):
        crc = crc32(source.read_at(at, min(_CRC_BYTES, end - at)), crc)
    if crc == stored:
        return
    walk.spans = [span for span in walk.spans if isinstance(span, ChunkSpan)]
    first, last = loose[0].offset, loose[-1].offset + loose[-1].length
    detail = "the check sum of the data section does not match; it is the only one over the messages outside chunks"
    walk.damages.append(Damage("data_crc_mismatch", first, last - first, dict(+walk.loose_counts), detail))


def _learn_from_chunks(source: Source, walk: Walk) -> None:
    """Read chunks for the schemas and channels that nothing else declares, and no more chunks than needed."""
    for span in walk.spans:
        if not isinstance(span, ChunkSpan) or not _may_teach(span, walk):
            continue
        loaded = load_span(source, span)
        place = (span.offset, span.length)
        walk.damages += [
            *conflicts(loaded.channels, walk.channels, place),
            *conflicts(loaded.schemas, walk.schemas, place),
        ]
        walk.schemas = loaded.schemas | walk.schemas
        walk.channels = loaded.channels | walk.channels


def _may_teach(span: ChunkSpan, walk: Walk) -> bool:
    # A summary that lists schemas lists them all.
    complete = walk.by_summary and walk.schemas
    if not complete and any(c.schema_id and c.schema_id not in walk.schemas for c in walk.channels.values()):
        return True
    ids: Iterable[int] | None = walk.indexed.get(span.offset)
    if ids is None:
        ids = walk.claimed
    return ids is None or not set(ids) <= walk.channels.keys()
