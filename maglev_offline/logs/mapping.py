"""From a `[signals]` table and a log's channels: which topic gives which signal of which suspension point."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from maglev_offline.errors import LogError
from maglev_offline.logs.channels import ChannelInfo
from maglev_offline.logs.detection import describe, detect, suggest
from maglev_offline.logs.signals import COLUMN_OF_SIGNAL, UNIT_OF_SIGNAL, Signal, SignalMap
from maglev_offline.logs.units import to_si_factor


@dataclass(frozen=True)
class TopicPlan:
    """What to take from one topic: its signals by name, and the points that they belong to."""

    topic: str
    signals: dict[str, Signal]
    points: tuple[str, ...]

    @property
    def paths(self) -> tuple[str, ...]:
        """The dotted paths to read, each once."""
        return tuple(dict.fromkeys(signal.field for signal in self.signals.values()))


@dataclass(frozen=True)
class SignalPlan:
    """How a log is read: the map in use, what each topic gives, and where each signal of a point comes from.

    `sources` is point -> signal name -> topic. `incomplete` tells for each point that cannot be used what it lacks.
    `detected` says that the map was found by names and units and was not given.
    """

    signal_map: SignalMap
    detected: bool
    topics: dict[str, TopicPlan]
    sources: dict[str, dict[str, str]]
    incomplete: dict[str, str]


def resolve(
    signal_map: SignalMap | None, channels: Sequence[ChannelInfo], *, where: str = "", leave_out: Collection[str] = ()
) -> SignalPlan:
    """Find the topics that a signal map speaks of; without a map, first find the map by names and units.

    A signal with a topic pattern of its own that has no group `point` is shared by all points (the speed of the
    vehicle, say). `leave_out` names signals that are mapped but not to be read.

    Raises
    ------
    LogError: no point has all signals that the map names; two topics give the same signal of the same point; or
        without a map, none can be found. The error lists what the log holds and offers a table to paste.
    """
    detected = signal_map is None
    used = detect(channels, where=where) if signal_map is None else signal_map
    signals = {name: signal for name, signal in used.signals().items() if name not in leave_out}
    by_topic: dict[str, list[ChannelInfo]] = {}
    for channel in channels:
        if channel.message_count:
            by_topic.setdefault(channel.topic, []).append(channel)

    found: dict[str, dict[str, list[str]]] = {}
    shared: dict[str, list[str]] = {}
    lacking: dict[str, list[str]] = {}
    for name, signal in signals.items():
        is_shared = signal.topic is not None and "point" not in re.compile(signal.topic).groupindex
        for topic, its_channels in sorted(by_topic.items()):
            point = used.point_of(topic, signal)
            if point is None:
                continue
            if not any(channel.has(signal.field) for channel in its_channels):
                lacking.setdefault(name, []).append(f"topic {topic} has no numeric field {signal.field!r}")
            elif is_shared:
                shared.setdefault(name, []).append(topic)
            else:
                found.setdefault(point, {}).setdefault(name, []).append(topic)
    if not found and "gap" in shared:
        found[used.point_of(shared["gap"][0], used.gap) or "point"] = {}
    for names in found.values():
        for name, topics in shared.items():
            names.setdefault(name, []).extend(topics)

    sources, incomplete = _complete(signals, found, lacking, where)
    if not sources:
        raise _nothing_fits(used, signals, channels, by_topic, lacking, incomplete, where)
    for name, signal in signals.items():
        si_factor(name, signal, where=where)
    plans = _by_topic(signals, sources)
    _check_clock(used, plans, by_topic, where)
    return SignalPlan(used, detected, plans, sources, incomplete)


def si_factor(name: str, signal: Signal, *, where: str = "") -> float:
    """Return what turns the declared unit into the unit of the signal's column (LogError where it cannot).

    The unit of a context column is the end of its name (`speed_m_s`, `load_kg`, `chainage_m`); one with the unit
    `dimensionless` is taken as it is.
    """
    if name in UNIT_OF_SIGNAL:
        return to_si_factor(signal.unit, UNIT_OF_SIGNAL[name])
    factor = _context_factor(name, signal.unit)
    if factor is None:
        raise LogError(
            f"context column {name!r} does not end in a unit that {signal.unit!r} can be turned into.",
            where=where,
            todo="End its name in its unit, as in speed_m_s, load_kg or chainage_m.",
        )
    return factor


@cache
def _context_factor(name: str, declared: str) -> float | None:
    if declared == "dimensionless":
        return 1.0
    parts = name.split("_")
    for unit in ("/".join(parts[-2:]), parts[-1]):
        try:
            return to_si_factor(declared, _UNIT_SPELLINGS.get(unit, unit))
        except ValueError:
            continue
    return None


_UNIT_SPELLINGS = {"a": "A", "v": "V", "n": "N", "k": "K", "w": "W", "pa": "Pa", "hz": "Hz", "t": "tonne"}


def to_si(name: str, signal: Signal, raw: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Turn logged numbers into the column's values: sign * (raw + offset) * unit.

    Returns the values and whether each lies outside the signal's `valid` range (which NaN does not).
    """
    declared = raw + signal.offset if signal.offset else raw
    declared = -declared if signal.sign < 0 else declared
    outside = np.zeros(raw.shape, dtype=np.bool_)
    if signal.valid is not None:
        outside = (declared < signal.valid[0]) | (declared > signal.valid[1])
    factor = si_factor(name, signal)
    divisor = round(1 / factor)
    # 9 mm / 1000 is the same float64 as 0.009 m in a recipe, and 9 mm * 0.001 is not; a stop is met or missed by that.
    exact = divisor > 1 and abs(divisor * factor - 1) < 1e-12
    with np.errstate(invalid="ignore"):  # a signalling NaN says no more than any other
        return (declared / divisor if exact else declared * factor if factor != 1 else declared), outside


def column_of(name: str) -> str:
    """Return the column of the samples table for a signal: its own for a canonical one, the name for a context one."""
    return COLUMN_OF_SIGNAL.get(name, name)


def _complete(
    signals: Mapping[str, Signal],
    found: Mapping[str, Mapping[str, list[str]]],
    lacking: Mapping[str, list[str]],
    where: str,
) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    sources: dict[str, dict[str, str]] = {}
    incomplete: dict[str, str] = {}
    for point, topics_of in sorted(found.items()):
        for name, topics in topics_of.items():
            if len(topics) > 1:
                raise LogError(
                    f"the signal {name} of point {point!r} is given by {len(topics)} topics: {', '.join(topics)}.",
                    where=where,
                    todo="Narrow the topic pattern in [signals], or tell the points apart with (?P<point>...).",
                )
        missing = [name for name in signals if name not in topics_of]
        if missing:
            reasons = [reason for name in missing for reason in lacking.get(name, [])]
            incomplete[point] = f"lacks {', '.join(missing)}" + (f" ({'; '.join(reasons)})" if reasons else "")
        else:
            sources[point] = {name: topics_of[name][0] for name in signals}
    return sources, incomplete


def _by_topic(signals: Mapping[str, Signal], sources: Mapping[str, Mapping[str, str]]) -> dict[str, TopicPlan]:
    names: dict[str, dict[str, Signal]] = {}
    points: dict[str, dict[str, None]] = {}
    for point, topic_of in sources.items():
        for name, topic in topic_of.items():
            names.setdefault(topic, {})[name] = signals[name]
            points.setdefault(topic, {})[point] = None
    return {topic: TopicPlan(topic, names[topic], tuple(points[topic])) for topic in sorted(names)}


def _check_clock(
    used: SignalMap, topics: Mapping[str, TopicPlan], by_topic: Mapping[str, list[ChannelInfo]], where: str
) -> None:
    field = used.clock_field
    for topic in topics if field is not None else ():
        if not any(channel.has(field or "") for channel in by_topic[topic]):
            raise LogError(
                f"the clock field {field!r} is not on topic {topic}.",
                where=where,
                todo='Name a time stamp that every mapped topic has, or use clock = "log_time".\n'
                + describe(by_topic[topic]),
            )


def _nothing_fits(
    used: SignalMap,
    signals: Mapping[str, Signal],
    channels: Sequence[ChannelInfo],
    by_topic: Mapping[str, list[ChannelInfo]],
    lacking: Mapping[str, list[str]],
    incomplete: Mapping[str, str],
    where: str,
) -> LogError:
    matched = {t for t in by_topic for s in signals.values() if used.point_of(t, s) is not None}
    closed = sorted(t for t in matched if not any(channel.decodable for channel in by_topic[t]))
    if closed:
        what = f"the messages of {', '.join(closed)} have an encoding that cannot be decoded."
    elif lacking:
        reasons = dict.fromkeys(reason for each in lacking.values() for reason in each)
        what = f"the signal map does not fit the log: {'; '.join(reasons)}."
    elif incomplete:
        what = "no suspension point has all signals of the map: " + "; ".join(
            f"{point} {reason}" for point, reason in incomplete.items()
        )
        what += "."
    else:
        what = f"the topic pattern {used.topic!r} of the signal map matches no topic of the log that holds messages."
    return LogError(what, where=where, todo=suggest(channels))
