"""One log, or several files that are one recording: from its messages to samples, ledger and findings."""

import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from maglev_offline.errors import LogError
from maglev_offline.filesystems import Where
from maglev_offline.ingest import ledger, rules, samples
from maglev_offline.ingest.checks.damage import damage_findings
from maglev_offline.ingest.content import CONTENT, ContentSketch, save_content
from maglev_offline.ingest.decoded import DecodedLog, Part, decode_parts, open_parts
from maglev_offline.ingest.examine import Examined, Nowhere, Sink, examine
from maglev_offline.ingest.findings import FINDINGS, Finding, by_severity, save_findings
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.merge import Part as MergePart
from maglev_offline.ingest.merge import merge_order
from maglev_offline.ingest.point_work import Context
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.select import NOT_SELECTED_POINT, NOT_SELECTED_TOPIC, wants_point, wants_topic
from maglev_offline.logs.channels import ChannelInfo
from maglev_offline.logs.decode.library import ClockField
from maglev_offline.logs.mapping import SignalPlan, resolve
from maglev_offline.logs.reader import TopicWanted
from maglev_offline.logs.units import to_si_factor
from maglev_offline.progress import SILENT, Progress
from maglev_offline.tables import ParquetSink


@dataclass(frozen=True)
class IngestedLog:
    """What came of one log beside its tables: counts, what was left out by reason code, facts, findings, content."""

    counts: dict[str, int]
    left_out: dict[str, int]
    facts: dict[str, Any]
    findings: tuple[Finding, ...]
    content: dict[str, ContentSketch]


def ingest_log(
    where: Where | Sequence[Where],
    log_id: str,
    request: Request,
    out: Path | None = None,
    *,
    jobs: int = 1,
    progress: Progress = SILENT,
) -> IngestedLog:
    """Turn one log into samples; without a signal map the signals are found by names and units.

    Parameters
    ----------
    where: a file, or several that are read as one recording in order of time.
    out: folder for samples.parquet, quarantine.parquet, findings.json and content.parquet; None writes nothing.
    jobs: processes that share a large log; the bytes are the same.

    Raises
    ------
    LogError: the log cannot be read, its signals cannot be found, or fewer than two usable samples come of it.
    InputError: the parts overlap, or the selection does not fit the log.
    """
    parts = _in_order([where] if isinstance(where, str | Path) else where)
    plan = plan_of(parts, request)
    made = examine_parts(parts, plan, log_id, request, out, jobs=jobs, progress=progress)
    if made.counts["rows"] < 2:
        raise _too_few(parts, plan, request, made)
    return made


def plan_of(parts: Sequence[Part], request: Request) -> SignalPlan:
    """Which topic gives which signal of which point.

    Raises
    ------
    LogError: there are no messages, or the signals cannot be found.
    """
    where = str(parts[0].where)
    channels = [channel for part in parts for channel in part.info.channels]
    if not any(channel.message_count for channel in channels):
        told = sorted({damage.code for part in parts for damage in part.structure.damages})
        raise LogError(
            "the log holds no messages that can be read" + (f" ({', '.join(told)})." if told else "."),
            where=where,
            todo="Check what was recorded, and leave it out.",
        )
    settings = request.settings
    wanted = [c for c in _joined(channels) if wants_topic(request.select, c.topic)]
    if not wanted:
        raise LogError(
            f"the selection leaves out every topic of the log ({', '.join(sorted({c.topic for c in channels})[:8])}).",
            where=where,
            todo="Correct `topics` or `exclude_topics` of [select], or --topic.",
        )
    leave_out = ("velocity",) if settings.velocity == "central_difference" else ()
    plan = resolve(request.signals, wanted, where=where, leave_out=leave_out)
    if settings.velocity == "logged" and plan.signal_map.velocity is None:
        raise LogError(
            "the recipe wants the logged velocity, and no velocity is mapped.",
            where=where,
            todo='Map it in [signals], or use velocity = "auto" or "central_difference".',
        )
    return plan


def examine_parts(
    parts: Sequence[Part],
    plan: SignalPlan,
    log_id: str,
    request: Request,
    out: Path | None = None,
    *,
    jobs: int = 1,
    progress: Progress = SILENT,
) -> IngestedLog:
    """Decode and look at all parts; what comes of it may be nothing."""
    points = {point: sources for point, sources in plan.sources.items() if wants_point(request.select, point)}
    topics = {topic for sources in points.values() for topic in sources.values()}
    wanted = _wanted(plan, topics)
    where = ", ".join(str(part.where) for part in parts)
    with tempfile.TemporaryDirectory(prefix=".decoded-", dir=out) as scratch:
        decoded = decode_parts(parts, wanted, Path(scratch), jobs=jobs, progress=progress)
        beforehand = _beforehand(decoded, plan, topics, request)
        chosen = SignalPlan(
            plan.signal_map,
            plan.detected,
            {t: p for t, p in plan.topics.items() if t in topics},
            points,
            plan.incomplete,
        )
        first = [part.info.first_log_time_ns for part in parts if part.info.first_log_time_ns is not None]
        context = Context(log_id, chosen, wanted, request, min(first, default=0))
        with ExitStack() as stack:
            sink: Sink = Nowhere() if out is None else _Files(out, plan, stack)
            found = examine(context, decoded, beforehand, sink, jobs=jobs)
    came_in = sum(decoded.found.values()) + sum(lost.count for lost in decoded.lost)
    counts = _counts(came_in, found)
    ledger.check_sums(
        where,
        {"message": found.messages_left_out, "sample": found.rows_left_out},
        messages={"in": came_in, "used": found.used},
        rows={"in": found.grid_rows, "used": found.rows},
    )
    findings = tuple(by_severity([*damage_findings(log_id, parts, decoded), *found.findings]))
    if out is not None:
        save_findings(findings, out / FINDINGS)
        save_content(found.content, out / CONTENT)
    left_out = dict(sorted((found.messages_left_out + found.rows_left_out).items()))
    return IngestedLog(
        counts, left_out, _facts(parts, chosen, decoded, found, findings, request), findings, found.content
    )


class _Files:
    """The two tables of a log on disk."""

    def __init__(self, out: Path, plan: SignalPlan, stack: ExitStack) -> None:
        context = tuple(plan.signal_map.context)
        self._samples = stack.enter_context(samples.open_samples(out / samples.SAMPLES, context))
        self._quarantine = stack.enter_context(ParquetSink(out / samples.QUARANTINE, ledger.SCHEMA))

    def samples(self, table: pa.Table) -> None:
        self._samples.write(table)

    def quarantine(self, table: pa.Table) -> None:
        self._quarantine.write(table)


def _in_order(where: Sequence[Where]) -> list[Part]:
    parts = open_parts(where)
    if len(parts) == 1:
        return parts
    times = {
        str(part.where): MergePart(
            str(part.where),
            {
                c.topic: (c.first_log_time_ns, c.last_log_time_ns)
                for c in part.info.channels
                if c.first_log_time_ns is not None and c.last_log_time_ns is not None
            },
        )
        for part in parts
    }
    by_name = {str(part.where): part for part in parts}
    return [by_name[part.name] for part in merge_order(times.values())]


def _joined(channels: Sequence[ChannelInfo]) -> list[ChannelInfo]:
    """The channels of all parts, those that are alike but for their counts once."""
    found: dict[tuple[object, ...], ChannelInfo] = {}
    for channel in channels:
        if channel.message_count:
            key = (channel.topic, channel.message_encoding, channel.schema_name, channel.fields)
            found.setdefault(key, channel)
    return list(found.values())


def _wanted(plan: SignalPlan, topics: set[str]) -> dict[str, TopicWanted]:
    used = plan.signal_map
    clock = None
    if used.clock_field is not None:
        clock = ClockField(used.clock_field, to_si_factor(used.clock_unit, "s") * 1e9)
    return {topic: TopicWanted(one.paths, clock) for topic, one in plan.topics.items() if topic in topics}


def _beforehand(decoded: DecodedLog, plan: SignalPlan, topics: set[str], request: Request) -> list[Quarantined]:
    """Entries for messages that were lost, and for those of topics that are not looked at."""
    entries = [
        ledger.together(lost.topic, lost.code, lost.count, lost.detail, byte_offset=lost.byte_offset)
        for lost in decoded.lost
    ]
    for topic, count in decoded.found.items():
        if topic in topics:
            continue
        if not wants_topic(request.select, topic):
            entries.append(ledger.together(topic, NOT_SELECTED_TOPIC, count))
        elif topic in plan.topics:
            entries.append(ledger.together(topic, NOT_SELECTED_POINT, count))
        else:
            entries.append(ledger.together(topic, rules.UNMAPPED, count, _why_unmapped(topic, plan)))
    return entries


def _why_unmapped(topic: str, plan: SignalPlan) -> str:
    for signal in plan.signal_map.signals().values():
        point = plan.signal_map.point_of(topic, signal)
        if point in plan.incomplete:
            return f"point {point} {plan.incomplete[point]}"
    return ""


def _counts(came_in: int, found: Examined) -> dict[str, int]:
    return {
        "messages": came_in,
        "messages_used": found.used,
        "messages_quarantined": came_in - found.used,
        "grid_rows": found.grid_rows,
        "rows": found.rows,
        "rows_quarantined": found.grid_rows - found.rows,
        "points": sum(n > 0 for n in found.rows_of.values()),
        "segments": sum(found.segments.values()),
        "contacts": found.contacts,
    }


def _too_few(parts: Sequence[Part], plan: SignalPlan, request: Request, made: IngestedLog) -> LogError:
    reasons = ", ".join(f"{code} {count:,}" for code, count in made.left_out.items()) or "it holds no messages"
    failures: Mapping[str, str] = made.facts["failures"]
    first = next((f" The first failure to decode, on {topic}: {text}." for topic, text in failures.items()), "")
    told = next((f"{one.what} {one.todo} " for one in made.findings if one.severity == "error"), "")
    if "not_selected_point" in made.left_out:
        told = f"The log has the points {', '.join(plan.sources)}. {told}"
    return LogError(
        f"fewer than two usable samples come of the log; left out: {reasons}.{first}",
        where=", ".join(str(part.where) for part in parts),
        todo=f"{told}Look at the log with `maglev-offline inspect`; check the signals, their units, clock = "
        f'"{plan.signal_map.clock}", and grid_ms = {request.settings.grid_ms:g} against its period.',
    )


def _facts(
    parts: Sequence[Part],
    plan: SignalPlan,
    decoded: DecodedLog,
    found: Examined,
    findings: Sequence[Finding],
    request: Request,
) -> dict[str, Any]:
    kept = [point for point, rows in found.rows_of.items() if rows]
    none = {point: "no usable sample" for point, rows in found.rows_of.items() if not rows}
    logged = plan.signal_map.velocity is not None and request.settings.velocity != "central_difference"
    severities: Counter[str] = Counter(finding.severity for finding in findings)
    return {
        "simulated": any(part.info.simulated for part in parts),
        "metadata": {name: record for part in parts for name, record in part.info.metadata.items()},
        "first_t_ns": found.first_t_ns,
        "last_t_ns": found.last_t_ns,
        "points": kept,
        "points_left_out": {**plan.incomplete, **none},
        "signals": plan.signal_map.model_dump(mode="json"),
        "signals_detected": plan.detected,
        "velocity": "logged" if logged else "central_difference",
        "set_point": "logged" if plan.signal_map.set_point is not None else "plant",
        "context": list(plan.signal_map.context),
        "topics": found.timing,
        "decoded_by": dict(sorted(decoded.rungs.items())),
        "failures": decoded.failures,
        "whole_file": all(part.info.whole for part in parts),
        "findings": {severity: severities[severity] for severity in ("error", "warning", "info")},
    }
