"""One log from its messages to its samples, its ledger and its facts."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from maglev_offline.errors import LogError
from maglev_offline.ingest import checks, clock, ledger, samples
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.points import PointSamples, assemble
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.ingest.topics import CleanTopic, clean
from maglev_offline.logs.mapping import SignalPlan, resolve
from maglev_offline.logs.reader import ClockField, LogInfo, read_columns, read_info
from maglev_offline.logs.signals import UNIT_OF_SIGNAL, SignalMap
from maglev_offline.logs.units import to_si_factor
from maglev_offline.physics.parameters import Plant


@dataclass(frozen=True)
class IngestedLog:
    """What came of one log: the two tables, counts, what was left out by reason code, and the stage's findings."""

    samples: pa.Table
    quarantine: pa.Table
    counts: dict[str, int]
    left_out: dict[str, int]
    facts: dict[str, Any]


def ingest_log(
    path: Path, log_id: str, *, signals: SignalMap | None, settings: IngestSettings, plant: Plant
) -> IngestedLog:
    """Turn one log into samples; without a signal map the signals are found by names and units.

    Raises
    ------
    LogError: the log cannot be read, its signals cannot be found, or fewer than two usable samples come of it.
    """
    where = str(path)
    info = read_info(path)
    if not any(channel.message_count for channel in info.channels):
        raise LogError("the log holds no messages.", where=where, todo="Check what was recorded, and leave it out.")
    leave_out = ("velocity",) if settings.velocity == "central_difference" else ()
    plan = resolve(signals, info.channels, where=where, leave_out=leave_out)
    if settings.velocity == "logged" and plan.signal_map.velocity is None:
        raise LogError(
            "the recipe wants the logged velocity, and no velocity is mapped.",
            where=where,
            todo='Map it in [signals], or use velocity = "auto" or "central_difference".',
        )
    log = read_columns(path, {name: topic.paths for name, topic in plan.topics.items()}, _clock_fields(plan))

    entries: list[Quarantined] = []
    topics: dict[str, CleanTopic] = {}
    for name, topic_plan in plan.topics.items():
        topics[name], found = clean(log.topics[name], topic_plan, plan.signal_map, settings)
        entries += found
    points = [assemble(point, sources, topics, settings, plant) for point, sources in plan.sources.items()]
    for point in points:
        entries += point.entries
    used = 0
    for topic in topics.values():
        of_rows, found = _without_partner(topic, points)
        used += of_rows
        entries += found
    entries += [
        ledger.whole_topic(name, checks.UNMAPPED, count, _why_unmapped(name, plan))
        for name, count in log.message_counts.items()
        if name not in topics
    ]

    rows = sum(len(point.t_ns) for point in points)
    messages = {"in": sum(log.message_counts.values()), "used": used}
    grid_rows = {"in": sum(point.grid_rows for point in points), "used": rows}
    ledger.check_sums(where, entries, messages=messages, rows=grid_rows)
    left_out = ledger.counts(entries)
    if rows < 2:
        reasons = ", ".join(f"{code} {count:,}" for code, count in left_out.items()) or "it holds no messages"
        raise LogError(
            f"fewer than two usable samples come of the log; left out: {reasons}.",
            where=where,
            todo=f"Look at the log with `maglev-offline inspect`; check the signals, their units, clock = "
            f'"{plan.signal_map.clock}", and grid_ms = {settings.grid_ms:g} against its period.',
        )
    counts = {
        "messages": messages["in"],
        "messages_used": used,
        "messages_quarantined": messages["in"] - used,
        "grid_rows": grid_rows["in"],
        "rows": rows,
        "rows_quarantined": grid_rows["in"] - rows,
        "points": sum(len(point.t_ns) > 0 for point in points),
        "segments": sum(int(point.segment[-1]) + 1 for point in points if len(point.segment)),
        "contacts": sum(int(point.contact.sum()) for point in points),
    }
    return IngestedLog(
        samples.table(log_id, points, tuple(plan.signal_map.context)),
        ledger.table(log_id, entries),
        counts,
        left_out,
        _facts(info, plan, topics, points, settings),
    )


def _clock_fields(plan: SignalPlan) -> dict[str, ClockField]:
    used = plan.signal_map
    if used.clock_field is None:
        return {}
    field = ClockField(used.clock_field, to_si_factor(used.clock_unit, "s") * 1e9)
    return dict.fromkeys(plan.topics, field)


def _without_partner(topic: CleanTopic, points: list[PointSamples]) -> tuple[int, list[Quarantined]]:
    """How many messages of a topic rows came of, and ledger entries for the others."""
    nothing = np.zeros(len(topic.t_ns), dtype=np.bool_)
    within = np.logical_or.reduce([nothing, *(p.within[topic.topic] for p in points if topic.topic in p.within)])
    used = np.logical_or.reduce([nothing, *(p.used[topic.topic] for p in points if topic.topic in p.used)])
    return int(used.sum()), [
        topic.put_aside(~within, checks.NO_PARTNER),
        topic.put_aside(within & ~used, checks.TOO_SHORT, "no grid instant in the stretch"),
    ]


def _why_unmapped(topic: str, plan: SignalPlan) -> str:
    for signal in plan.signal_map.signals().values():
        point = plan.signal_map.point_of(topic, signal)
        if point in plan.incomplete:
            return f"point {point} {plan.incomplete[point]}"
    return ""


def _facts(
    info: LogInfo,
    plan: SignalPlan,
    topics: Mapping[str, CleanTopic],
    points: list[PointSamples],
    settings: IngestSettings,
) -> dict[str, Any]:
    kept = [point for point in points if len(point.t_ns)]
    logged = plan.signal_map.velocity is not None and settings.velocity != "central_difference"
    return {
        "simulated": info.simulated,
        "metadata": info.metadata,
        "first_t_ns": min(int(point.t_ns.min()) for point in kept),
        "last_t_ns": max(int(point.t_ns.max()) for point in kept),
        "points": [point.point for point in kept],
        "points_left_out": {**plan.incomplete, **{p.point: "no usable sample" for p in points if not len(p.t_ns)}},
        "signals": plan.signal_map.model_dump(mode="json"),
        "signals_detected": plan.detected,
        "velocity": "logged" if logged else "central_difference",
        "set_point": "logged" if plan.signal_map.set_point is not None else "plant",
        "context": [name for name in plan.signal_map.context if name not in UNIT_OF_SIGNAL],
        "topics": {name: _timing(topic) for name, topic in topics.items()},
    }


def _timing(topic: CleanTopic) -> dict[str, Any]:
    """Period as found within the stretches: a hole between two of them says nothing of it."""
    steps = np.diff(topic.t_ns)
    steps = steps[~np.isin(np.arange(1, len(topic.t_ns)), topic.stretches.first)]
    found = {"messages": len(topic.t_ns), "stretches": len(topic.stretches), "resets": topic.resets}
    if len(steps) == 0:
        return {**found, "period_ms": None, "jitter_ms": None}
    return {
        **found,
        "period_ms": float(np.median(steps)) / clock.NS_PER_MS,
        "jitter_ms": float(np.std(steps)) / clock.NS_PER_MS,
    }
