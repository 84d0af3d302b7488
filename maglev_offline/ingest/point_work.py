"""The work on one suspension point in one window of a log: check its topics, put them on the grid, look at them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import clock
from maglev_offline.ingest.checks.point import point_findings
from maglev_offline.ingest.checks.recording import recording_findings
from maglev_offline.ingest.checks.signals import signal_findings
from maglev_offline.ingest.chosen_rows import choose_rows
from maglev_offline.ingest.content import ContentHasher
from maglev_offline.ingest.findings import Finding
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.median import median
from maglev_offline.ingest.points import PointSamples, assemble
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.select import messages_mask
from maglev_offline.ingest.topics import CleanTopic, clean
from maglev_offline.ingest.windows import Window
from maglev_offline.logs.mapping import SignalPlan
from maglev_offline.logs.reader import TopicWanted


@dataclass(frozen=True)
class Context:
    """What is the same for all points and windows of a log. `first_ns` is the log's first log time."""

    log_id: str
    plan: SignalPlan
    wanted: Mapping[str, TopicWanted]
    request: Request
    first_ns: int


@dataclass(frozen=True)
class TopicDone:
    """What came of a topic's messages in a window."""

    clean: CleanTopic
    entries: list[Quarantined]
    findings: list[Finding]
    timing: dict[str, Any]


@dataclass(frozen=True)
class PointDone:
    """What came of a point in a window: its samples, and its own topics (those that no other point uses)."""

    samples: PointSamples
    topics: dict[str, TopicDone]
    findings: list[Finding]
    content: ContentHasher


def do_topic(context: Context, window: Window, topic: str) -> TopicDone:
    """Check the messages of one topic."""
    plan, request = context.plan, context.request
    columns, index = window.columns(topic, context.wanted[topic], plan.signal_map.clock, request.settings)
    chosen = None
    if request.select.start is not None or request.select.end is not None:
        chosen = messages_mask(topic, columns.log_time_ns, request.select, context.first_ns)
    topic_plan = plan.topics[topic]
    found, entries = clean(columns, topic_plan, plan.signal_map, request.settings, index=index, chosen=chosen)
    findings = recording_findings(
        context.log_id, columns, found, entries, plan.signal_map, request.settings, request.checks, message=index
    )
    findings += signal_findings(context.log_id, found, topic_plan, request.plant, request.checks)
    return TopicDone(found, entries, findings, timing(found))


def do_point(
    context: Context, window: Window, point: str, shared: Mapping[str, CleanTopic], content: ContentHasher
) -> PointDone:
    """Turn the messages of one point into samples; `shared` holds the topics that several points use."""
    sources = context.plan.sources[point]
    own = {topic: do_topic(context, window, topic) for topic in dict.fromkeys(sources.values()) if topic not in shared}
    topics = {**shared, **{topic: done.clean for topic, done in own.items()}}
    request = context.request
    samples = assemble(point, sources, topics, request.settings, request.plant)
    samples = choose_rows(samples, sources["gap"], request.select)
    findings = point_findings(context.log_id, samples, request.plant, request.checks)
    gap = topics[sources["gap"]]
    state = ("gap", "current", "voltage")
    content.add({name: gap.values[name] for name in state if sources[name] == gap.topic}, gap.t_ns)
    return PointDone(samples, own, findings, content)


def timing(topic: CleanTopic) -> dict[str, Any]:
    """Period as found within the stretches: a hole between two of them says nothing of it."""
    steps = np.diff(topic.t_ns)
    if len(topic.stretches) > 1:
        within: NDArray[np.bool_] = np.ones(len(steps), dtype=np.bool_)
        within[topic.stretches.first[1:] - 1] = False
        steps = steps[within]
    found = {"messages": len(topic.t_ns), "stretches": len(topic.stretches), "resets": topic.resets}
    if len(steps) == 0:
        return {**found, "period_ms": None, "jitter_ms": None}
    return {
        **found,
        "period_ms": median(steps) / clock.NS_PER_MS,
        "jitter_ms": float(np.std(steps)) / clock.NS_PER_MS,
    }
