"""The wanted fields of a log's messages as columns, decoded many at a time."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from maglev_offline.errors import LogError
from maglev_offline.logs.chunks import load_span
from maglev_offline.logs.columns import NO_TIME, ChannelColumns
from maglev_offline.logs.decode.ladder import Columns, Ladder
from maglev_offline.logs.decode.library import ClockField, Decoders
from maglev_offline.logs.decode.payloads import Payloads, Wanted
from maglev_offline.logs.gathering import Gathering
from maglev_offline.logs.scan import read_structure
from maglev_offline.logs.slabs import (
    FILE_INDEX,
    LOG_TIME,
    PUBLISH_TIME,
    ROWS,
    SEQUENCE,
    STAMP,
    Cut,
    Files,
    MemorySlab,
    Piece,
    Slab,
    by_topic,
    join_cuts,
    join_pieces,
)
from maglev_offline.logs.source import Source, open_source
from maglev_offline.logs.structure import Damage, Loaded, MessageTable, Span, Structure
from maglev_offline.memory import keep_freed_memory

RUN_BYTES = 16 * 2**20
"""Spans are decoded in runs of about so many bytes: the unit of work that is shared among processes."""

_MOST_PER_FILE_BYTE = 32
"""A log may claim any number of messages: no more memory is asked for beforehand than so many times its size."""

_UNDECLARED, _UNWANTED = -2, -1


class TopicWanted(NamedTuple):
    """What to read of one topic: dotted paths, and the stamp inside the messages. With neither, only headers."""

    paths: tuple[str, ...]
    clock: ClockField | None = None


@dataclass(frozen=True)
class ReadRun:
    """What came of a run of spans: slabs in file order, and for each the messages (of any topic) that it spans.

    `counts` are messages found by channel id, wanted or not; `rungs` counts the ways of decoding; `failures` holds
    the first failure of a topic.
    """

    slabs: tuple[tuple[Slab, int], ...]
    counts: dict[int, int]
    rungs: dict[str, int]
    failures: dict[str, str]
    damages: tuple[Damage, ...]


def runs(structure: Structure) -> list[tuple[Span, ...]]:
    """Cut the spans of a file into runs, the same ones whoever decodes them."""
    found: list[list[Span]] = []
    size = RUN_BYTES
    for span in structure.spans:
        if size >= RUN_BYTES:
            found.append([])
            size = 0
        found[-1].append(span)
        size += span.length
    return [tuple(run) for run in found]


def read_run(
    source: Source,
    structure: Structure,
    spans: Sequence[Span],
    wanted: Mapping[str, TopicWanted],
    *,
    spill_to: Path | None = None,
    gathering: Gathering | None = None,
) -> ReadRun:
    """Decode a run of spans; with `spill_to` its slabs are written to that file, otherwise they stay in memory.

    `gathering` is memory that consecutive runs share.

    Raises
    ------
    LogError: a wanted topic has an encoding or a schema that cannot be read.
    """
    keep_freed_memory()
    groups = _Groups(source.name, structure, wanted)
    slabs: list[tuple[Slab, int]] = []
    counts: Counter[int] = Counter()
    damages: list[Damage] = []
    first = total = waiting = 0
    file: BinaryIO | None = spill_to.open("wb") if spill_to is not None else None
    try:
        for number, span in enumerate(spans):
            loaded = load_span(source, span, structure.channels)
            damages += loaded.damages
            counts.update(loaded.counts)
            waiting += groups.add(loaded, total - first)
            total += len(loaded.messages)
            if waiting >= ROWS or number == len(spans) - 1:
                slab = groups.slab()
                if file is not None:
                    slabs.append((slab.spill(file), total - first))
                else:
                    slabs.append((slab if gathering is None else gathering.take_in(slab), total - first))
                first, waiting = total, 0
    finally:
        if file is not None:
            file.close()
    return ReadRun(tuple(slabs), dict(counts), groups.rungs(), groups.failures(), tuple(damages))


def read_columns(
    path: Path | str, wanted: Mapping[str, Sequence[str]], clocks: Mapping[str, ClockField] | None = None
) -> dict[str, ChannelColumns]:
    """Decode the wanted dotted paths of the wanted topics of a log that fits into memory.

    `wanted`: for each topic its paths; with no paths the messages are listed but not decoded. Channels that share a
    topic are merged in file order. A path that names a time gives seconds. `clocks`: for a topic the time stamp
    inside its messages. What is damaged is left out.

    Raises
    ------
    LogError: no MCAP file, or a wanted topic has an encoding or a schema that cannot be read.
    """
    clocks = clocks or {}
    asked = {topic: TopicWanted(tuple(paths), clocks.get(topic)) for topic, paths in wanted.items()}
    with open_source(path) as source:
        structure = read_structure(source)
        expected: Counter[str] = Counter()
        for channel_id, count in (structure.claimed or {}).items():
            if channel_id in structure.channels:
                expected[structure.channels[channel_id].topic] += count
        room = Gathering(expected, _MOST_PER_FILE_BYTE * source.size)
        slabs = [
            pair
            for spans in runs(structure)
            for pair in read_run(source, structure, spans, asked, gathering=room).slabs
        ]
    return {topic: topic_columns(slabs, topic, asked[topic]) for topic in wanted}


def topic_columns(slabs: Sequence[tuple[Slab, int]], topic: str, wanted: TopicWanted, first: int = 0) -> ChannelColumns:
    """All messages of a topic in consecutive slabs, the first of which begins at the file index `first`."""
    cuts: list[Cut] = []
    before: list[int] = []
    with Files() as files:
        for slab, spanned in slabs:
            cut = slab.cut(topic, files)
            if cut is not None:
                cuts.append(cut)
                before.append(first)
            first += spanned
    if not cuts:
        cuts, before = [(_empty(wanted), 0, 0)], [0]
    whole = join_cuts(cuts)
    offsets = np.repeat(before, [stop - first for _, first, stop in cuts])
    log_time, publish_time, sequence, file_index, *stamp = whole.integers
    return ChannelColumns(
        topic=topic,
        log_time_ns=log_time,
        publish_time_ns=publish_time,
        sequence=sequence,
        file_index=file_index + offsets,
        values=dict(zip(wanted.paths, whole.values, strict=True)),
        decoded=whole.decoded,
        clock_ns=stamp[0] if stamp else None,
    )


def _empty(wanted: TopicWanted) -> Piece:
    integers = np.empty((5 if wanted.clock else 4, 0), dtype=np.int64)
    return Piece(integers, np.empty((len(wanted.paths), 0)), np.empty(0, dtype=np.bool_))


@dataclass
class _Group:
    """Topics that share a schema and what is wanted of it, and the rows of theirs that wait for their slab."""

    wanted: TopicWanted
    ladder: Ladder | None
    topics: list[str] = field(default_factory=list)
    rows: list[tuple[NDArray[np.uint16], Piece]] = field(default_factory=list)


class _Groups:
    """Sorts messages by what has to be done with them."""

    def __init__(self, where: str, structure: Structure, wanted: Mapping[str, TopicWanted]) -> None:
        self._where = where
        self._decoders = Decoders()
        self._groups: list[_Group] = []
        self._keys: dict[tuple[object, ...], int] = {}
        self._group_of = np.full(2**16, _UNDECLARED, dtype=np.int32)
        self._topic_of = np.zeros(2**16, dtype=np.uint16)
        for channel_id, channel in sorted(structure.channels.items()):
            self._group_of[channel_id] = _UNWANTED
            if channel.topic in wanted:
                schema = structure.schemas.get(channel.schema_id)
                self._enter(channel_id, channel, schema, wanted[channel.topic])

    def _enter(self, channel_id: int, channel: Channel, schema: Schema | None, wanted: TopicWanted) -> None:
        key = (channel.message_encoding, channel.schema_id, wanted)
        if key not in self._keys:
            self._keys[key] = len(self._groups)
            self._groups.append(_Group(wanted, self._ladder(channel, schema, wanted)))
        group = self._groups[self._keys[key]]
        if channel.topic not in group.topics:
            group.topics.append(channel.topic)
        self._group_of[channel_id] = self._keys[key]
        self._topic_of[channel_id] = group.topics.index(channel.topic)

    def _ladder(self, channel: Channel, schema: Schema | None, wanted: TopicWanted) -> Ladder | None:
        if not wanted.paths and wanted.clock is None:
            return None
        paths = tuple(tuple(path.split(".")) for path in wanted.paths)
        try:
            return Ladder(channel, schema, Wanted(paths, wanted.clock), self._decoders)
        except ValueError as error:
            raise LogError(
                f"the messages of topic {channel.topic} cannot be decoded: {error}.",
                where=self._where,
                todo="Encodings that can be: json, cdr with ros2msg, ros1 with ros1msg, protobuf. If it is one of "
                "these, the schema is damaged: record the log again with whole message definitions.",
            ) from None

    def add(self, loaded: Loaded, first: int) -> int:
        """Decode the messages of one span; `first` is the index of its first one. Returns how many rows were added."""
        messages = loaded.messages
        present = {int(self._group_of[channel]) for channel in loaded.counts}
        added = 0
        for number in sorted(present - {_UNDECLARED, _UNWANTED}):
            group = self._groups[number]
            whole = len(present) == 1
            rows = np.arange(len(messages)) if whole else np.flatnonzero(self._group_of[messages.channel_id] == number)
            which: slice | NDArray[np.intp] = slice(None) if whole else rows
            columns = (
                group.ladder.decode(Payloads(loaded.data, messages.start[which], messages.length[which]))
                if group.ladder is not None
                else Columns(np.empty((0, len(rows))), None, np.ones(len(rows), dtype=np.bool_))
            )
            integers = _integers(messages, which, columns.stamp_ns)
            np.add(rows, first, out=integers[FILE_INDEX])
            piece = Piece(integers, columns.values, columns.decoded)
            group.rows.append((self._topic_of[messages.channel_id[which]], piece))
            added += len(rows)
        return added

    def slab(self) -> MemorySlab:
        """The rows that wait, sorted by topic."""
        topics: dict[str, Cut] = {}
        for group in self._groups:
            if group.rows:
                topic_of_row = np.concatenate([topic for topic, _ in group.rows])
                made = by_topic(join_pieces([piece for _, piece in group.rows]), topic_of_row, group.topics)
                for topic in topics.keys() & made.topics.keys():
                    # Channels of one topic with different schemas meet here; their messages keep the file's order.
                    both = join_cuts([topics[topic], made.topics[topic]])
                    both = both.take(np.argsort(both.integers[FILE_INDEX], kind="stable"))
                    made.topics[topic] = (both, 0, len(both))
                topics |= made.topics
                group.rows.clear()
        return MemorySlab(topics)

    def rungs(self) -> dict[str, int]:
        """How many messages each way of decoding has read."""
        total: Counter[str] = Counter()
        for group in self._groups:
            if group.ladder is not None:
                total.update(group.ladder.rungs)
        return dict(total)

    def failures(self) -> dict[str, str]:
        """The first failure to decode a message of each group, by the group's first topic."""
        return {g.topics[0]: g.ladder.first_failure for g in self._groups if g.ladder and g.ladder.first_failure}


def _integers(
    messages: MessageTable, which: slice | NDArray[np.intp], stamp_ns: NDArray[np.int64] | None
) -> NDArray[np.int64]:
    """All of a `Piece` but the file index. Times after the year 2262 do not fit: they become `NO_TIME`."""
    sequence = messages.sequence[which]
    found = np.empty((4 if stamp_ns is None else 5, len(sequence)), dtype=np.int64)
    found[LOG_TIME], found[PUBLISH_TIME] = messages.log_time_ns[which], messages.publish_time_ns[which]
    found[SEQUENCE] = sequence
    times = found[:SEQUENCE]
    if times.min(initial=0) < 0:
        times[times < 0] = NO_TIME
    if stamp_ns is not None:
        found[STAMP] = stamp_ns
    return found
