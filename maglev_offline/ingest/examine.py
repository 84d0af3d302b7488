"""A log from its messages to samples, ledger and findings, window by window and point by point."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from maglev_offline.ingest import ledger, rules, samples
from maglev_offline.ingest.checks.merge import merge
from maglev_offline.ingest.content import ContentHasher, ContentSketch
from maglev_offline.ingest.decoded import DecodedLog
from maglev_offline.ingest.findings import Finding
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.point_work import Context, PointDone, TopicDone, do_point, do_topic
from maglev_offline.ingest.points import PointSamples
from maglev_offline.ingest.topics import CleanTopic
from maglev_offline.ingest.windows import Window, windows
from maglev_offline.logs.slabs import MemorySlab
from maglev_offline.memory import give_back
from maglev_offline.spread import spread


class Sink(Protocol):
    """Takes the tables of a log as they come."""

    def samples(self, table: pa.Table) -> None:
        """Rows of the samples table."""

    def quarantine(self, table: pa.Table) -> None:
        """Rows of the ledger."""


class Nowhere:
    """Takes tables and keeps nothing: for a look at a log."""

    def samples(self, table: pa.Table) -> None:
        """Drop the rows."""

    def quarantine(self, table: pa.Table) -> None:
        """Drop the rows."""


@dataclass
class Examined:
    """What was found, added up over windows and points.

    `used` are messages that rows came of, `grid_rows` the rows that were made, `rows` those that were kept. `left_out`
    counts by reason code, of messages and of rows.
    """

    used: int = 0
    grid_rows: int = 0
    rows: int = 0
    segments: Counter[str] = field(default_factory=Counter)
    rows_of: Counter[str] = field(default_factory=Counter)
    contacts: int = 0
    first_t_ns: int | None = None
    last_t_ns: int | None = None
    messages_left_out: Counter[str] = field(default_factory=Counter)
    rows_left_out: Counter[str] = field(default_factory=Counter)
    findings: list[Finding] = field(default_factory=list)
    timing: dict[str, dict[str, Any]] = field(default_factory=dict)
    content: dict[str, ContentSketch] = field(default_factory=dict)


def examine(
    context: Context, decoded: DecodedLog, beforehand: list[Quarantined], sink: Sink, *, jobs: int = 1
) -> Examined:
    """Go through a decoded log. `beforehand` are the entries of the ledger that need no look at the messages."""
    found = Examined()
    mapped = {topic: context.wanted[topic] for topic in context.plan.topics}
    by, settings = context.plan.signal_map.clock, context.request.settings
    hashers = {point: ContentHasher() for point in context.plan.sources}
    entries = list(beforehand)
    for window in windows(decoded.slabs, mapped, by, settings):
        _window(context, window, hashers, found, entries, sink, jobs)
        entries = []
        give_back()
    _put_aside(context.log_id, entries, found, sink)
    found.findings = merge(found.findings)
    found.content = {point: hasher.sketch() for point, hasher in hashers.items()}
    return found


def _window(
    context: Context,
    window: Window,
    hashers: dict[str, ContentHasher],
    found: Examined,
    entries: list[Quarantined],
    sink: Sink,
    jobs: int,
) -> None:
    plan = context.plan
    uses = Counter(topic for sources in plan.sources.values() for topic in dict.fromkeys(sources.values()))
    shared = {topic: do_topic(context, window, topic) for topic in plan.topics if uses[topic] > 1}
    within = {topic: np.zeros(len(done.clean.t_ns), dtype=np.bool_) for topic, done in shared.items()}
    used = {topic: mask.copy() for topic, mask in within.items()}
    for done in _points(context, window, {t: s.clean for t, s in shared.items()}, hashers, jobs):
        point = done.samples
        hashers[point.point] = done.content
        for topic in shared.keys() & point.within.keys():
            within[topic] |= point.within[topic]
            used[topic] |= point.used[topic]
        entries += point.entries
        found.findings += done.findings
        for topic, own in done.topics.items():
            entries += _topic(own, point.within[topic], point.used[topic], found)
        sink.samples(_rows(context, point, found))
        if sum(entry.total for entry in entries) > 2**18:
            _put_aside(context.log_id, entries, found, sink)
            entries.clear()
    for topic, its in shared.items():
        entries += _topic(its, within[topic], used[topic], found)
    _put_aside(context.log_id, entries, found, sink)


def _points(
    context: Context,
    window: Window,
    shared: Mapping[str, CleanTopic],
    hashers: Mapping[str, ContentHasher],
    jobs: int,
) -> Iterator[PointDone]:
    points = list(context.plan.sources)
    if jobs > 1 and len(points) > 1 and not any(isinstance(slab, MemorySlab) for slab, _ in window.slabs):
        yield from spread(do_point, ((context, window, point, shared, hashers[point]) for point in points), jobs)
        return
    for point in points:
        yield do_point(context, window, point, shared, hashers[point])


def _topic(done: TopicDone, within: NDArray[np.bool_], used: NDArray[np.bool_], found: Examined) -> list[Quarantined]:
    """Add a topic up, and say of which of its messages no row came."""
    found.findings += done.findings
    found.used += int(used.sum())
    before = found.timing.get(done.clean.topic)
    found.timing[done.clean.topic] = done.timing if before is None else _longer(before, done.timing)
    entries = list(done.entries)
    if not used.all():
        entries += [
            done.clean.put_aside(~within & ~used, rules.NO_PARTNER),
            done.clean.put_aside(within & ~used, rules.TOO_SHORT, "no grid instant in the stretch"),
        ]
    return entries


def _longer(before: dict[str, Any], then: dict[str, Any]) -> dict[str, Any]:
    """Counts of consecutive windows add up; the period and the jitter are those of the first."""
    return {**before, **{key: before[key] + then[key] for key in ("messages", "stretches", "resets")}}


def _rows(context: Context, point: PointSamples, found: Examined) -> pa.Table:
    n = len(point.t_ns)
    found.grid_rows += point.grid_rows
    found.rows += n
    found.rows_of[point.point] += n
    found.contacts += int(point.contact.sum())
    plan, first = context.plan, found.segments[point.point]
    table = samples.table(context.log_id, point, tuple(plan.sources), tuple(plan.signal_map.context), first)
    if n:
        found.segments[point.point] += int(point.segment[-1]) + 1
        begin, end = int(point.t_ns.min()), int(point.t_ns.max())
        found.first_t_ns = begin if found.first_t_ns is None else min(found.first_t_ns, begin)
        found.last_t_ns = end if found.last_t_ns is None else max(found.last_t_ns, end)
    return table


def _put_aside(log_id: str, entries: list[Quarantined], found: Examined, sink: Sink) -> None:
    found.messages_left_out.update(ledger.counts(entries, "message"))
    found.rows_left_out.update(ledger.counts(entries, "sample"))
    sink.quarantine(ledger.table(log_id, entries))
