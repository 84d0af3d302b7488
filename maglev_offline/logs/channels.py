"""What a log says of itself: its channels with their fields, counts and times, and its metadata records."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Channel, Schema

from maglev_offline.logs.chunks import load_span
from maglev_offline.logs.counts import ChannelCount, count_messages
from maglev_offline.logs.decode.library import UNDECODABLE, Decoders, can_decode
from maglev_offline.logs.scan import read_structure
from maglev_offline.logs.schema_fields import NOTHING, DeclaredFields, declared_fields, declares, fields_of_value
from maglev_offline.logs.source import Source, open_source
from maglev_offline.logs.structure import Structure


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
    """What a log says of itself without decoding it (but for the first message of a channel without a schema).

    `whole` says that the file ends as it should and that its summary holds.
    """

    channels: tuple[ChannelInfo, ...]
    metadata: dict[str, dict[str, str]]
    compressions: tuple[str, ...]
    size_bytes: int
    whole: bool

    @property
    def simulated(self) -> bool:
        """Whether a metadata record says that no plant was measured here."""
        return any(record.get("simulated", "").lower() == "true" for record in self.metadata.values())

    @property
    def first_log_time_ns(self) -> int | None:
        """Earliest log time of any message."""
        return min((c.first_log_time_ns for c in self.channels if c.first_log_time_ns is not None), default=None)


def read_info(where: Path | str) -> LogInfo:
    """Read channels, metadata records and compressions; what is damaged is passed over.

    Raises
    ------
    LogError: the file is no MCAP file, or is empty.
    """
    with open_source(where) as source:
        return read_survey(source)[0]


def list_channels(where: Path | str) -> tuple[ChannelInfo, ...]:
    """List the channels of a log in order of their ids; LogError as for `read_info`."""
    return read_info(where).channels


def read_survey(source: Source) -> tuple[LogInfo, Structure]:
    """What a log says of itself, and where everything lies in it."""
    structure = read_structure(source)
    counted = count_messages(source, structure)
    declared = {number: _declared(structure.schemas.get(c.schema_id)) for number, c in structure.channels.items()}
    silent = [
        number
        for number, channel in structure.channels.items()
        if channel.message_encoding == "json" and not declared[number].numbers and number in counted
    ]
    declared |= _first_messages(source, structure, silent)
    channels = [
        _channel_info(structure, channel, declared[number], counted.get(number))
        for number, channel in sorted(structure.channels.items())
    ]
    compressions = tuple(sorted(structure.compressions))
    return LogInfo(tuple(channels), structure.metadata, compressions, source.size, structure.whole), structure


def _channel_info(
    structure: Structure, channel: Channel, declared: DeclaredFields, counted: ChannelCount | None
) -> ChannelInfo:
    schema = structure.schemas.get(channel.schema_id)
    return ChannelInfo(
        id=channel.id,
        topic=channel.topic,
        message_encoding=channel.message_encoding,
        schema_encoding=schema.encoding if schema else "",
        schema_name=schema.name if schema else "",
        message_count=counted.messages if counted is not None else 0,
        first_log_time_ns=counted.first_ns if counted else None,
        last_log_time_ns=counted.last_ns if counted else None,
        fields=declared.numbers,
        times=declared.times,
    )


def _declared(schema: Schema | None) -> DeclaredFields:
    return declared_fields(schema.encoding, schema.name, schema.data) if schema else NOTHING


def _first_messages(source: Source, structure: Structure, awaited: Iterable[int]) -> dict[int, DeclaredFields]:
    """Fields of the first message of each JSON channel whose schema declares none, by channel id."""
    left = set(awaited)
    decoders = Decoders()
    found: dict[int, DeclaredFields] = {}
    for span in structure.spans:
        if not left:
            break
        loaded = load_span(source, span, structure.channels)
        for number in sorted(left):
            rows = (loaded.messages.channel_id == number).nonzero()[0]
            if len(rows):
                left.remove(number)
                start, length = int(loaded.messages.start[rows[0]]), int(loaded.messages.length[rows[0]])
                decoder = decoders.of(structure.channels[number], None)
                try:
                    payload = loaded.data[start : start + length].tobytes()
                    found[number] = fields_of_value(decoder(payload)) if decoder else NOTHING
                except UNDECODABLE:
                    found[number] = NOTHING
    return found
