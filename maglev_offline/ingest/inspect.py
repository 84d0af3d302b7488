"""A look at a log: what is in it, how fast, which signals would be taken, and what the checks find."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.errors import LogError
from maglev_offline.filesystems import Where, name_of
from maglev_offline.ingest.checks.damage import damage_findings
from maglev_offline.ingest.clock import NS_PER_MS, steps_of
from maglev_offline.ingest.content import ContentSketch
from maglev_offline.ingest.decoded import DecodedLog, Part, open_parts
from maglev_offline.ingest.findings import Finding, by_severity
from maglev_offline.ingest.log import examine_parts, plan_of
from maglev_offline.ingest.request import Request
from maglev_offline.logs.channels import ChannelInfo
from maglev_offline.logs.reader import TopicWanted, read_run, runs
from maglev_offline.logs.slabs import LOG_TIME, Files
from maglev_offline.logs.source import open_source
from maglev_offline.logs.structure import Damage
from maglev_offline.progress import SILENT, Progress


@dataclass(frozen=True)
class ChannelSummary:
    """One channel; the times are log times, None where there are too few messages.

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
    """What a log holds. Either `signals` is the map that would be used, or `why_no_signals` says what is missing.

    `counts` and `left_out` are those that ingestion would give, empty without signals.
    """

    file: str
    size_bytes: int
    sha256: str
    simulated: bool
    whole_file: bool
    metadata: dict[str, dict[str, str]]
    compressions: tuple[str, ...]
    messages: int
    channels: tuple[ChannelSummary, ...]
    signals: dict[str, Any] | None
    points: tuple[str, ...]
    points_left_out: dict[str, str]
    why_no_signals: str
    counts: dict[str, int]
    left_out: dict[str, int]
    decoded_by: dict[str, int]

    def as_dict(self) -> dict[str, Any]:
        """The summary as plain JSON values."""
        return asdict(self)


@dataclass(frozen=True)
class Inspected:
    """The summary of a log, what the checks found, and a sketch of the content of each point."""

    summary: LogSummary
    findings: tuple[Finding, ...]
    content: dict[str, ContentSketch]


def inspect_log(where: Where, request: Request, *, jobs: int = 1, progress: Progress = SILENT) -> Inspected:
    """Look at a whole log as ingestion would, and keep nothing.

    Raises
    ------
    LogError: the file is no MCAP file, or is empty. Signals that cannot be found are no error here.
    """
    (part,) = open_parts([where])
    with open_source(where) as source:
        sha256 = source.sha256()
    times, damages = _log_times(part)
    name = name_of(where)
    try:
        plan = plan_of([part], request)
        made = examine_parts([part], plan, name, request, jobs=jobs, progress=progress)
    except LogError as error:
        bare = DecodedLog((), {}, (), {}, {}, tuple((0, d) for d in (*part.structure.damages, *damages)))
        told = by_severity(damage_findings(name, [part], bare))
        nothing = _summary(part, sha256, times, None, (), {}, error.paragraph())
        return Inspected(nothing, tuple(told), {})
    signals = plan.signal_map.model_dump(mode="json", exclude_defaults=True)
    left_out = made.facts["points_left_out"]
    summary = _summary(part, sha256, times, signals, tuple(plan.sources), left_out, "")
    counted = {"counts": made.counts, "left_out": made.left_out, "decoded_by": made.facts["decoded_by"]}
    return Inspected(LogSummary(**{**vars(summary), **counted}), made.findings, made.content)


def _summary(
    part: Part,
    sha256: str,
    times: dict[str, NDArray[np.int64]],
    signals: dict[str, Any] | None,
    points: Sequence[str],
    left_out: dict[str, str],
    why: str,
) -> LogSummary:
    info = part.info
    return LogSummary(
        file=name_of(part.where),
        size_bytes=info.size_bytes,
        sha256=sha256,
        simulated=info.simulated,
        whole_file=info.whole,
        metadata=info.metadata,
        compressions=info.compressions,
        messages=sum(len(t) for t in times.values()),
        channels=tuple(_channel(channel, times[channel.topic]) for channel in info.channels),
        signals=signals,
        points=tuple(points),
        points_left_out=left_out,
        why_no_signals=why,
        counts={},
        left_out={},
        decoded_by={},
    )


def _log_times(part: Part) -> tuple[dict[str, NDArray[np.int64]], list[Damage]]:
    """Log times of every topic in file order, and what of the chunks could not be used."""
    headers = {channel.topic: TopicWanted(()) for channel in part.info.channels}
    found: dict[str, list[NDArray[np.int64]]] = {topic: [] for topic in headers}
    damages: list[Damage] = []
    with open_source(part.where) as source, Files() as files:
        for spans in runs(part.structure):
            read = read_run(source, part.structure, spans, headers)
            damages += read.damages
            for slab, _ in read.slabs:
                for topic, times in found.items():
                    cut = slab.cut(topic, files)
                    if cut is not None:
                        times.append(cut[0].integers[LOG_TIME, cut[1] : cut[2]])
    nothing = np.empty(0, dtype=np.int64)
    return {topic: np.concatenate([nothing, *parts]) for topic, parts in found.items()}, damages


def _channel(channel: ChannelInfo, log_time_ns: NDArray[np.int64]) -> ChannelSummary:
    in_time = np.sort(log_time_ns)
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
        steps_back=int((np.diff(log_time_ns) < 0).sum()),
        fields=channel.fields,
        times=channel.times,
    )
