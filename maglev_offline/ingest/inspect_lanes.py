"""The time line of a log: a lane for each topic and point, with the places of the findings on it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from maglev_offline.ingest.findings import SEVERITIES, Finding

MOST_LANES = 60
"""A log of more topics shows those with findings first."""

WIDTH = 1000.0
"""Length of a lane, in its own units."""

_LEAST = 3.0
_MOST_MARKS = 300


@dataclass(frozen=True)
class Mark:
    """A place on a lane, from `x` on for `width`, and its words; a `long` one says little of where, so it is thin."""

    x: float
    width: float
    severity: str
    words: str

    @property
    def long(self) -> bool:
        """Whether it is nearly as long as the log."""
        return self.width > 0.8 * WIDTH


@dataclass(frozen=True)
class Lane:
    """A topic or a point; `bars` are the stretches (x, width) in which there are messages."""

    name: str
    bars: Sequence[tuple[float, float]]
    marks: Sequence[Mark]
    words: str


def time_range(channels: Sequence[Mapping[str, Any]]) -> tuple[int, int] | None:
    """First and last time of a log's messages in ns; None without messages."""
    times = [
        channel[name]
        for channel in channels
        for name in ("first_log_time_ns", "last_log_time_ns")
        if channel[name] is not None
    ]
    return (min(times), max(times)) if times else None


def lanes_of(
    channels: Sequence[Mapping[str, Any]], findings: Sequence[Finding], span: tuple[int, int]
) -> tuple[Lane, ...]:
    """A lane for each topic in their order, then one for each point that a finding speaks of without a topic.

    A channel may have `stretches`, pairs of first and last time; without them it is one from its first to its last.
    Places outside the span lie at its end.
    """
    stretches: dict[str, list[tuple[int, int]]] = {}
    for channel in channels:
        if channel["first_log_time_ns"] is not None and channel["last_log_time_ns"] is not None:
            whole = [(channel["first_log_time_ns"], channel["last_log_time_ns"])]
            stretches.setdefault(channel["topic"], []).extend(channel.get("stretches") or whole)
    placed: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        if any(place.start_ns is not None for place in finding.places):
            key = ("topic", finding.topic) if finding.topic in stretches else ("point", finding.point)
            placed.setdefault(key, []).append(finding)
    lanes = [
        _lane(topic, [_bar(span, *stretch) for stretch in its], placed.get(("topic", topic), []), span)
        for topic, its in stretches.items()
    ]
    for kind, point in sorted(key for key in placed if key[0] == "point"):
        name = f"point {point}" if point else "the whole log"
        lanes.append(_lane(name, [], placed[kind, point], span))
    if len(lanes) > MOST_LANES:
        lanes.sort(key=lambda lane: not lane.marks)
    return tuple(lanes[:MOST_LANES])


def _lane(name: str, bars: list[tuple[float, float]], findings: Sequence[Finding], span: tuple[int, int]) -> Lane:
    # The worst are drawn last, on top.
    ordered = sorted(findings, key=lambda f: SEVERITIES.index(f.severity))
    marks = []
    for finding in ordered:
        for place in finding.places:
            if place.start_ns is not None:
                end = place.end_ns if place.end_ns is not None else place.start_ns
                marks.append(
                    Mark(*_bar(span, place.start_ns, end), finding.severity, f"{finding.severity}: {finding.code}")
                )
    told = sorted({f"{f.code} ({f.severity})" for f in findings})
    words = f"{name}: " + (", ".join(told) if told else "no findings")
    return Lane(name, bars, marks[-_MOST_MARKS:], words)


def _bar(span: tuple[int, int], start_ns: int, end_ns: int) -> tuple[float, float]:
    """Place and length on a lane, kept on it and never too short to be seen."""
    length = max(span[1] - span[0], 1)
    first, last = (WIDTH * min(max((t - span[0]) / length, 0.0), 1.0) for t in (start_ns, max(end_ns, start_ns)))
    width = max(last - first, _LEAST)
    return round(min(first, WIDTH - width), 2), round(width, 2)
