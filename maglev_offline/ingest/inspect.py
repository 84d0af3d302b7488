"""A first look at a log: what is in it, how fast, and which signals would be taken."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maglev_offline.errors import LogError
from maglev_offline.ingest.clock import NS_PER_MS, steps_of
from maglev_offline.logs.mapping import resolve
from maglev_offline.logs.reader import ChannelColumns, ChannelInfo, read_columns, read_info
from maglev_offline.logs.signals import SignalMap
from maglev_offline.workspace import sha256_of


@dataclass(frozen=True)
class ChannelSummary:
    """One channel; the times are log times in file order, None where there are too few messages.

    `period_ms` is the median of the steps, `jitter_ms` their standard deviation, `longest_silence_ms` the greatest;
    channels that share a topic share them. `steps_back` counts messages that are earlier than the one before.
    """

    topic: str
    message_encoding: str
    schema_encoding: str
    schema_name: str
    decodable: bool
    messages: int
    first_log_time_ns: int | None
    last_log_time_ns: int | None
    period_ms: float | None
    jitter_ms: float | None
    longest_silence_ms: float | None
    steps_back: int
    fields: tuple[str, ...]
    times: tuple[str, ...]


@dataclass(frozen=True)
class LogSummary:
    """What a log holds. Either `signals` is the map that would be used, or `why_no_signals` says what is missing."""

    file: str
    size_bytes: int
    sha256: str
    simulated: bool
    metadata: dict[str, dict[str, str]]
    compressions: tuple[str, ...]
    messages: int
    channels: tuple[ChannelSummary, ...]
    signals: dict[str, Any] | None
    points: tuple[str, ...]
    points_left_out: dict[str, str]
    why_no_signals: str

    def as_dict(self) -> dict[str, Any]:
        """The summary as plain JSON values."""
        return asdict(self)


def inspect_log(path: Path, signals: SignalMap | None = None) -> LogSummary:
    """Look at a whole log; every check sum in it is checked, its payloads are not decoded.

    Raises
    ------
    LogError: the file is no MCAP file, is empty, cut off or damaged. Signals that cannot be found are no error here.
    """
    info = read_info(path)
    log = read_columns(path, {channel.topic: () for channel in info.channels})
    used: dict[str, Any] | None = None
    points: Sequence[str] = ()
    left_out: dict[str, str] = {}
    why = ""
    try:
        plan = resolve(signals, info.channels)
        used = plan.signal_map.model_dump(mode="json", exclude_defaults=True)
        points, left_out = tuple(plan.sources), plan.incomplete
    except LogError as error:
        why = error.paragraph()
    return LogSummary(
        file=path.name,
        size_bytes=path.stat().st_size,
        sha256=sha256_of(path),
        simulated=info.simulated,
        metadata=info.metadata,
        compressions=info.compressions,
        messages=sum(log.message_counts.values()),
        channels=tuple(_channel(channel, log.topics[channel.topic]) for channel in info.channels),
        signals=used,
        points=tuple(points),
        points_left_out=left_out,
        why_no_signals=why,
    )


def _channel(channel: ChannelInfo, columns: ChannelColumns) -> ChannelSummary:
    in_time = np.sort(columns.log_time_ns)
    median, jitter, longest = (None if value is None else value / NS_PER_MS for value in steps_of(in_time))
    return ChannelSummary(
        topic=channel.topic,
        message_encoding=channel.message_encoding,
        schema_encoding=channel.schema_encoding,
        schema_name=channel.schema_name,
        decodable=channel.decodable,
        messages=channel.message_count,
        first_log_time_ns=channel.first_log_time_ns,
        last_log_time_ns=channel.last_log_time_ns,
        period_ms=median,
        jitter_ms=jitter,
        longest_silence_ms=longest,
        steps_back=int((np.diff(columns.log_time_ns) < 0).sum()),
        fields=channel.fields,
        times=channel.times,
    )
