"""The wanted fields of a log's messages as columns.

What lies behind `read_columns` may be replaced by a faster way to the same arrays.
"""

from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Message, Schema, Statistics
from numpy.typing import NDArray

from maglev_offline.errors import LogError
from maglev_offline.logs.channels import ChannelInfo, LogInfo, list_channels, read_info
from maglev_offline.logs.decoding import UNDECODABLE, ClockField, Decoder, Decoders, clock_ns, number, value_at
from maglev_offline.logs.records import walk

__all__ = [
    "NO_TIME",
    "ChannelColumns",
    "ChannelInfo",
    "ClockField",
    "LogColumns",
    "LogInfo",
    "list_channels",
    "read_columns",
    "read_info",
]

NO_TIME = int(np.iinfo(np.int64).min)
"""In an array of nanoseconds: there is no time here."""


@dataclass(frozen=True)
class ChannelColumns:
    """The messages of one topic in file order, n of them; every array has shape [n].

    `file_index` is the place among all messages of the file. `values` holds float64 by dotted path, NaN where the
    field is missing or no number. `decoded` is False where the payload could not be read at all. `clock_ns` is the
    time stamp inside the messages, `NO_TIME` where it is missing; None if no clock field was asked for.
    """

    topic: str
    log_time_ns: NDArray[np.int64]
    publish_time_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    file_index: NDArray[np.int64]
    values: dict[str, NDArray[np.float64]]
    decoded: NDArray[np.bool_]
    clock_ns: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.log_time_ns)


@dataclass(frozen=True)
class LogColumns:
    """The wanted topics as columns, and how many messages every topic of the file has."""

    topics: dict[str, ChannelColumns]
    message_counts: dict[str, int]


def read_columns(
    path: Path, wanted: Mapping[str, Sequence[str]], clocks: Mapping[str, ClockField] | None = None
) -> LogColumns:
    """Decode the wanted dotted paths of the wanted topics in one pass over the file.

    Parameters
    ----------
    wanted: for each topic its paths; with no paths the messages are listed but not decoded. Channels that share a
        topic are merged in file order. A path that names a time gives seconds.
    clocks: for a topic the time stamp inside its messages, read into integer nanoseconds.

    Raises
    ------
    LogError: the file is damaged (see `walk`), a wanted topic has an encoding that cannot be decoded, or not one
        message of it could be; or the file holds more or fewer messages than it says.
    """
    clocks = clocks or {}
    decoders = Decoders()
    columns = {topic: _Columns(topic, tuple(paths), clocks.get(topic)) for topic, paths in wanted.items()}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    takers: dict[int, tuple[_Columns, Decoder | None] | None] = {}
    counts: Counter[int] = Counter()
    claimed: int | None = None
    file_index = 0
    for record in walk(path):
        if isinstance(record, Message):
            channel_id = record.channel_id
            counts[channel_id] += 1
            if channel_id not in takers:
                takers[channel_id] = _taker(path, columns, channels, schemas, channel_id, decoders)
            taker = takers[channel_id]
            if taker is not None:
                taker[0].add(record, file_index, taker[1])
            file_index += 1
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Statistics):
            claimed = record.message_count
    if claimed is not None and claimed != file_index:
        raise LogError(
            f"the log is damaged: it says that it holds {claimed:,} messages, and {file_index:,} were found.",
            where=str(path),
            todo="Nothing of it was used. Copy it again, or write a whole file with `mcap recover`.",
        )
    by_topic: Counter[str] = Counter()
    for channel_id, channel in channels.items():
        by_topic[channel.topic] += counts[channel_id]
    return LogColumns(
        {topic: column.finish(path) for topic, column in columns.items()},
        {topic: n for topic, n in sorted(by_topic.items()) if n},
    )


def _taker(
    path: Path,
    columns: Mapping[str, "_Columns"],
    channels: Mapping[int, Channel],
    schemas: Mapping[int, Schema],
    channel_id: int,
    decoders: Decoders,
) -> "tuple[_Columns, Decoder | None] | None":
    channel = channels.get(channel_id)
    if channel is None:
        raise LogError(
            f"the log is damaged: there are messages of channel {channel_id}, which is declared nowhere before them.",
            where=str(path),
            todo="Write a whole file with `mcap recover`, and use that.",
        )
    column = columns.get(channel.topic)
    if column is None:
        return None
    if not column.needs_decoding:
        return column, None
    schema = schemas.get(channel.schema_id)
    try:
        decoder = decoders.of(channel, schema)
    except ValueError as error:
        raise LogError(
            f"the schema {schema.name if schema else ''!r} of topic {channel.topic} cannot be read ({error}).",
            where=str(path),
            todo="Record the log again with whole message definitions.",
        ) from None
    if decoder is None:
        spoken = f"{channel.message_encoding!r} with schema encoding {schema.encoding if schema else ''!r}"
        raise LogError(
            f"the messages of topic {channel.topic} are encoded as {spoken}, which cannot be decoded.",
            where=str(path),
            todo="Encodings that can be: json, cdr with ros2msg, protobuf.",
        )
    return column, decoder


class _Columns:
    """Growing columns of one topic."""

    def __init__(self, topic: str, paths: tuple[str, ...], clock: ClockField | None) -> None:
        self.topic, self.paths, self.clock = topic, paths, clock
        self.needs_decoding = bool(paths) or clock is not None
        self._parts = [tuple(path.split(".")) for path in paths]
        self._clock_parts = tuple(clock.path.split(".")) if clock else ()
        self._header = [array("Q"), array("Q"), array("Q"), array("Q")]
        self._values = [array("d") for _ in paths]
        self._decoded = array("b")
        self._clock = array("q")
        self._first_failure: BaseException | None = None

    def add(self, message: Message, file_index: int, decoder: Decoder | None) -> None:
        seen = (message.log_time, message.publish_time, message.sequence, file_index)
        for column, value in zip(self._header, seen, strict=True):
            column.append(value)
        if decoder is None:
            self._decoded.append(1)
            return
        content: Any = None
        try:
            content = decoder(message.data)
            self._decoded.append(1)
        except UNDECODABLE as error:
            self._first_failure = self._first_failure or error
            self._decoded.append(0)
        for values, parts in zip(self._values, self._parts, strict=True):
            values.append(number(value_at(content, parts)))
        if self.clock is not None:
            stamp = clock_ns(value_at(content, self._clock_parts), self.clock.ns_per_unit)
            self._clock.append(NO_TIME if stamp is None else stamp)

    def finish(self, path: Path) -> ChannelColumns:
        header = [np.frombuffer(column, dtype=np.uint64) for column in self._header]
        if any(len(column) and column.max() >= 2**63 for column in header):
            raise LogError(
                f"topic {self.topic} has log or publish times after the year 2262.",
                where=str(path),
                todo="MCAP times are nanoseconds since 1970: write the log again with its times mended.",
            )
        decoded = np.frombuffer(self._decoded, dtype=np.int8).astype(np.bool_)
        if self._first_failure is not None and not decoded.any():
            raise LogError(
                f"not one of the {len(decoded):,} messages of topic {self.topic} can be decoded "
                f"({type(self._first_failure).__name__}: {self._first_failure}).",
                where=str(path),
                todo="The schema does not fit the messages: record the log again.",
            )
        log_time, publish_time, sequence, file_index = (column.astype(np.int64) for column in header)
        return ChannelColumns(
            topic=self.topic,
            log_time_ns=log_time,
            publish_time_ns=publish_time,
            sequence=sequence,
            file_index=file_index,
            values={p: np.frombuffer(v, dtype=np.float64) for p, v in zip(self.paths, self._values, strict=True)},
            decoded=decoded,
            clock_ns=np.frombuffer(self._clock, dtype=np.int64) if self.clock is not None else None,
        )
