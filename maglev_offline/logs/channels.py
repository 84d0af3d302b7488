"""What a log says of itself: its channels with their fields, counts and times, and its metadata records."""

import struct
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.summary import Summary

from maglev_offline.logs.decoding import UNDECODABLE, Decoders, can_decode
from maglev_offline.logs.records import open_log, read_summary, walk
from maglev_offline.logs.schema_fields import NOTHING, DeclaredFields, declared_fields, declares, fields_of_value


@dataclass(frozen=True)
class ChannelInfo:
    """A channel as its schema declares it; times are the earliest and latest log time, None without messages."""

    id: int
    topic: str
    message_encoding: str
    schema_encoding: str
    schema_name: str
    message_count: int
    first_log_time_ns: int | None
    last_log_time_ns: int | None
    fields: tuple[str, ...]
    times: tuple[str, ...]

    @property
    def decodable(self) -> bool:
        """Whether its messages can be decoded."""
        return can_decode(self.message_encoding, self.schema_encoding)

    def has(self, path: str) -> bool:
        """Whether the dotted path is a numeric field or a time stamp of the messages."""
        return declares(self.fields, path) or declares(self.times, path)


@dataclass(frozen=True)
class LogInfo:
    """What a log says of itself without decoding it (but for the first message of a channel without a schema)."""

    channels: tuple[ChannelInfo, ...]
    metadata: dict[str, dict[str, str]]
    compressions: tuple[str, ...]

    @property
    def simulated(self) -> bool:
        """Whether a metadata record says that no plant was measured here."""
        return any(record.get("simulated", "").lower() == "true" for record in self.metadata.values())


def read_info(path: Path) -> LogInfo:
    """Read channels, metadata records and compressions; from the summary section where it is whole.

    Raises
    ------
    LogError: the file is no MCAP file, is empty, cut off or damaged.
    """
    draft = _info_from_summary(path) or _info_from_records(path)
    first = _first_messages(path, draft)
    channels = []
    for channel_id, channel in sorted(draft.channels.items()):
        schema = draft.schemas.get(channel.schema_id)
        declared = declared_fields(schema.encoding, schema.name, schema.data) if schema else NOTHING
        if channel_id in first:
            declared = first[channel_id]
        times = draft.log_times.get(channel_id)
        channels.append(
            ChannelInfo(
                id=channel_id,
                topic=channel.topic,
                message_encoding=channel.message_encoding,
                schema_encoding=schema.encoding if schema else "",
                schema_name=schema.name if schema else "",
                message_count=draft.counts.get(channel_id, 0),
                first_log_time_ns=times[0] if times else None,
                last_log_time_ns=times[1] if times else None,
                fields=declared.numbers,
                times=declared.times,
            )
        )
    return LogInfo(tuple(channels), draft.metadata, tuple(sorted(draft.compressions)))


def list_channels(path: Path) -> tuple[ChannelInfo, ...]:
    """List the channels of a log in order of their ids; LogError as for `read_info`."""
    return read_info(path).channels


@dataclass
class _InfoDraft:
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    log_times: dict[int, tuple[int, int]] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    compressions: set[str] = field(default_factory=set)

    def saw(self, channel_id: int, earliest: int, latest: int) -> None:
        known = self.log_times.get(channel_id, (earliest, latest))
        self.log_times[channel_id] = (min(known[0], earliest), max(known[1], latest))


def _info_from_records(path: Path) -> _InfoDraft:
    draft = _InfoDraft()
    for record in walk(path):
        if isinstance(record, Message):
            draft.counts[record.channel_id] += 1
            draft.saw(record.channel_id, record.log_time, record.log_time)
        elif isinstance(record, Schema):
            draft.schemas[record.id] = record
        elif isinstance(record, Channel):
            draft.channels[record.id] = record
        elif isinstance(record, Metadata):
            draft.metadata[record.name] = dict(record.metadata)
        elif isinstance(record, Chunk):
            draft.compressions.add(record.compression or "none")
    return draft


def _info_from_summary(path: Path) -> _InfoDraft | None:
    """None where the indexes are not complete; the records themselves then have to be read."""
    summary = read_summary(path)
    if summary is None or summary.statistics is None or not summary.chunk_indexes:
        return None
    if summary.statistics.metadata_count != len(summary.metadata_indexes):
        return None
    draft = _InfoDraft(schemas=dict(summary.schemas), channels=dict(summary.channels))
    draft.compressions = {index.compression or "none" for index in summary.chunk_indexes}
    try:
        _read_indexes(path, summary, draft)
    except (struct.error, ValueError, OSError):
        return None
    claimed = {channel: n for channel, n in summary.statistics.channel_message_counts.items() if n}
    known = {0, *draft.schemas}
    complete = (
        claimed == dict(draft.counts)
        and set(claimed) <= set(draft.channels)
        and all(channel.schema_id in known for channel in draft.channels.values())
    )
    return draft if complete and sum(claimed.values()) == summary.statistics.message_count else None


def _read_indexes(path: Path, summary: Summary, draft: _InfoDraft) -> None:
    with open_log(path) as file:
        for chunk in summary.chunk_indexes:
            for offset in chunk.message_index_offsets.values():
                file.seek(offset)
                opcode, _, channel_id, size = struct.unpack("<BQHI", file.read(15))
                if opcode != 0x07:
                    raise ValueError("no message index where one should be")
                times = np.frombuffer(file.read(size), dtype="<u8")[::2]
                if len(times):
                    draft.counts[channel_id] += len(times)
                    draft.saw(channel_id, int(times.min()), int(times.max()))
        for index in summary.metadata_indexes:
            file.seek(index.offset + 9)
            record = Metadata.read(ReadDataStream(file))
            draft.metadata[record.name] = dict(record.metadata)


def _first_messages(path: Path, draft: _InfoDraft) -> dict[int, DeclaredFields]:
    """Fields of the first message of each JSON channel whose schema declares none, by channel id."""
    awaited = set()
    for channel_id, channel in draft.channels.items():
        schema = draft.schemas.get(channel.schema_id)
        declared = declared_fields(schema.encoding, schema.name, schema.data) if schema else NOTHING
        if channel.message_encoding == "json" and not declared.numbers and draft.counts.get(channel_id):
            awaited.add(channel_id)
    found: dict[int, DeclaredFields] = {}
    if not awaited:
        return found
    decode = Decoders()
    for record in walk(path):
        if isinstance(record, Message) and record.channel_id in awaited:
            awaited.remove(record.channel_id)
            decoder = decode.of(draft.channels[record.channel_id], None)
            try:
                found[record.channel_id] = fields_of_value(decoder(record.data)) if decoder else NOTHING
            except UNDECODABLE:
                found[record.channel_id] = NOTHING
            if not awaited:
                break
    return found
