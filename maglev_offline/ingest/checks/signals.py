"""What is wrong with the values of a topic's signals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.checks.codes import make
from maglev_offline.ingest.checks.levels import MEASURED, constant_runs, moving, pile, resting, spikes
from maglev_offline.ingest.checks.quantum import quantum
from maglev_offline.ingest.checks.settings import CheckSettings
from maglev_offline.ingest.checks.spectrum import fastest_rad_s
from maglev_offline.ingest.checks.timing import period_of, runs
from maglev_offline.ingest.checks.units import suspect
from maglev_offline.ingest.findings import MOST_PLACES, Finding, Place
from maglev_offline.ingest.topics import CleanTopic, point_in_ledger
from maglev_offline.logs.mapping import TopicPlan
from maglev_offline.logs.signals import UNIT_OF_SIGNAL
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Name = tuple[str, str, str]

_SOME = 2048
"""Levels and typical values are read off so many messages."""


@dataclass(frozen=True)
class _Signal:
    """One signal of a topic with what several checks need.

    `ordered` holds some of its values, sorted; `operation` is the plant's value at the set-point, `step` the quantum.
    """

    name: str
    values: Array
    ordered: Array
    spread: float
    low: float
    high: float
    operation: float | None
    step: float | None

    @property
    def unit(self) -> str:
        return UNIT_OF_SIGNAL[self.name]


# A log may hold any number: what overflows is out of every range, and is told or passed over as such.
@np.errstate(all="ignore")
def signal_findings(
    log: str, topic: CleanTopic, plan: TopicPlan, plant: Plant, settings: CheckSettings
) -> list[Finding]:
    """Findings about the values of one topic's signals: stuck, quantised, saturated, spikes, ranges and units."""
    if len(topic.t_ns) < 3:
        return []
    name = (log, topic.topic, point_in_ledger(topic.points))
    signals = {key: _signal(key, topic.values[key], plant) for key in MEASURED if key in topic.values}
    found: list[Finding] = []
    for signal in signals.values():
        found += suspect(name, signal.name, signal.ordered, signal.operation, plan.signals[signal.name], settings)
    wrong = {str(finding.numbers["signal"]) for finding in found}
    found += _stuck(name, topic, signals, plant, settings)
    for signal in signals.values():
        found += _quantised(name, topic, signal, settings)
        found += _saturated(name, topic, signal, settings)
        if signal.name not in wrong:
            found += _range(name, topic, signal, plant, settings)
    if _resolves(topic, plant):
        for signal in signals.values():
            found += _spikes(name, topic, signal, settings)
    return found


def _signal(name: str, values: Array, plant: Plant) -> _Signal:
    balance = plant.equilibrium()
    operation = {"gap": balance.gap_m, "current": balance.current_a, "voltage": balance.voltage_v}.get(name)
    ordered = np.sort(values[:: max(len(values) // _SOME, 1)])
    return _Signal(
        name=name,
        values=values,
        ordered=ordered,
        spread=float(np.std(ordered)),
        low=float(values.min()),
        high=float(values.max()),
        operation=operation,
        step=quantum(ordered),
    )


def _place(topic: CleanTopic, first: int, last: int) -> Place:
    return Place(
        int(topic.t_ns[first]), int(topic.t_ns[last]), int(topic.message_index[first]), int(topic.message_index[last])
    )


def _places(topic: CleanTopic, mask: Mask) -> tuple[list[Place], int]:
    """Runs of messages as places (the first of them), and how many runs there are."""
    first, last = runs(mask)
    firsts, lasts = first[:MOST_PLACES].tolist(), last[:MOST_PLACES].tolist()
    return [_place(topic, a, b) for a, b in zip(firsts, lasts, strict=True)], len(first)


def _stuck(
    name: Name, topic: CleanTopic, signals: dict[str, _Signal], plant: Plant, settings: CheckSettings
) -> list[Finding]:
    found = []
    spread = {key: signal.spread for key, signal in signals.items()}
    for key, signal in signals.items():
        firsts, lasts = constant_runs(signal.values, settings.stuck_messages)
        if len(firsts) and signal.step is not None and _coarse(signal, signal.step, settings):
            stuck = ~resting(signal.values, firsts, lasts, signal.step, topic.stretches.first)
            firsts, lasts = firsts[stuck], lasts[stuck]
        others = {other: signals[other].values for other in signals if other != key}
        kept = []
        for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True):
            # What stands at a limit is held there by the plant or the actuator, not by the sensor.
            if _at_limit(signal, float(signal.values[first]), plant):
                continue
            most = moving(others, spread, first, last, settings.moving_share)
            if most:
                kept.append((first, last, most))
        if kept:
            longest = max(kept, key=lambda run: run[1] - run[0])
            seconds = max(float(topic.t_ns[b] - topic.t_ns[a]) / 1e9 for a, b, _ in kept)
            numbers: dict[str, float | int | str] = {
                "signal": key,
                "longest_messages": longest[1] - longest[0] + 1,
                "longest_s": seconds,
                "moving": longest[2],
            }
            found.append(make("stuck", *name, numbers, places=[_place(topic, a, b) for a, b, _ in kept]))
    return found


def _at_limit(signal: _Signal, value: float, plant: Plant) -> bool:
    if signal.name == "gap":
        return value <= plant.gap_min_m or value >= plant.gap_max_m
    return signal.name != "velocity" and value in (signal.low, signal.high)


def _coarse(signal: _Signal, step: float, settings: CheckSettings) -> bool:
    of_operation = step / abs(signal.operation) if signal.operation else 0.0
    return of_operation > settings.quantum_share or step > settings.quantum_spread_share * signal.spread


def _quantised(name: Name, topic: CleanTopic, signal: _Signal, settings: CheckSettings) -> list[Finding]:
    step = signal.step
    if step is None or signal.spread == 0 or not _coarse(signal, step, settings):
        return []
    numbers: dict[str, float | int | str] = {
        "signal": signal.name,
        "quantum": step,
        "unit": signal.unit,
        "share_of_operation": step / abs(signal.operation) if signal.operation else 0.0,
        "share_of_spread": step / signal.spread,
        "of": len(signal.values),
    }
    return [make("quantised", *name, numbers, places=[_place(topic, 0, len(signal.values) - 1)])]


def _saturated(name: Name, topic: CleanTopic, signal: _Signal, settings: CheckSettings) -> list[Finding]:
    """The voltage at either end, a current at its upper one; a gap at its ends is a contact, a current at 0 is off."""
    span = signal.high - signal.low
    ends = {"voltage": ((signal.low, span), (signal.high, -span)), "current": ((signal.high, -span),)}
    found: list[Finding] = []
    for extreme, inward in ends.get(signal.name, ()) if span > 0 else ():
        at = pile(signal.values, extreme, inward, settings.saturation_share, signal.step)
        if at is None:
            continue
        places, count = _places(topic, at)
        messages = int(np.count_nonzero(at))
        numbers: dict[str, float | int | str] = {
            "signal": signal.name,
            "extreme": extreme,
            "unit": signal.unit,
            "messages": messages,
            "of": len(at),
            "share": messages / len(at),
            "limit": "lower" if inward > 0 else "upper",
        }
        found.append(make("saturated", *name, numbers, places=places, count=count))
    return found


def _range(name: Name, topic: CleanTopic, signal: _Signal, plant: Plant, settings: CheckSettings) -> list[Finding]:
    found: list[Finding] = []

    def told(code: str, mask: Mask, **more: float) -> None:
        places, count = _places(topic, mask)
        messages = int(np.count_nonzero(mask))
        numbers = {"messages": messages, "of": len(mask), "share": messages / len(mask), **more}
        found.append(make(code, *name, numbers, places=places, count=count))

    if signal.name == "gap":
        slack = settings.range_tolerance * (plant.gap_max_m - plant.gap_min_m)
        if signal.low < -slack:
            told("gap_below_zero", signal.values < -slack, smallest=signal.low)
        if signal.high > plant.gap_max_m + slack:
            told(
                "gap_beyond_stop", signal.values > plant.gap_max_m + slack, largest=signal.high, stop_m=plant.gap_max_m
            )
    elif signal.name == "current":
        least = -settings.range_tolerance * plant.equilibrium().current_a
        if signal.low < least:
            told("current_below_zero", signal.values < least, smallest=signal.low)
    return found


def _resolves(topic: CleanTopic, plant: Plant) -> bool:
    """Whether messages come so fast that the plant itself cannot jump away and back between three of them."""
    period_s = period_of(np.diff(topic.t_ns)) / 1e9
    return period_s > 0 and fastest_rad_s(plant) * period_s < 1.0


def _spikes(name: Name, topic: CleanTopic, signal: _Signal, settings: CheckSettings) -> list[Finding]:
    if signal.name == "voltage":  # a controller may do as it likes
        return []
    at = spikes(signal.values, settings.spike_factor, topic.stretches.first, topic.values.get("set_point"))
    if len(at) == 0:
        return []
    size = np.abs(signal.values[at] - 0.5 * (signal.values[at - 1] + signal.values[at + 1]))
    numbers: dict[str, float | int | str] = {
        "signal": signal.name,
        "largest_jump": float(size.max()),
        "unit": signal.unit,
    }
    places = [_place(topic, k, k) for k in at[:MOST_PLACES].tolist()]
    return [make("spikes", *name, numbers, places=places, count=len(at))]
