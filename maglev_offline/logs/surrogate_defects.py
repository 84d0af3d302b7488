"""Plants the defects of `[surrogate.defects]` in a record and tells where each of them is.

Values and messages are changed in true time, before the log's clock stamps them, and the stamps after it; places are
told in the stamps that the file has.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from maglev_offline.logs import surrogate_defect_settings as planted
from maglev_offline.logs.surrogate_defect_settings import PlantedDefects
from maglev_offline.logs.surrogate_record import MS, Index, Record, at_point, by_topic_in_time, in_stretch, with_repeats
from maglev_offline.streams import stream


class Scope(NamedTuple):
    """What an entry is planted with: when the log begins, and draws of its own."""

    epoch_ns: int
    rng: np.random.Generator


@dataclass
class Planted:
    """A defect: its kind, its settings, and the numbers of the messages that have it."""

    kind: str
    settings: dict[str, Any]
    numbers: Index
    each: bool = False
    """Whether every message is to be listed, and not the first and last of each topic."""
    more: dict[str, Index] = field(default_factory=dict)
    """Other messages that belong to it, such as those that a block repeats."""


def plant_in_messages(
    record: Record, settings: PlantedDefects, seed: int, log: int, epoch_ns: int
) -> tuple[Record, list[Planted]]:
    """Plant all that is in values and messages, in the order of the settings; the record has true times."""
    found = []
    for kind, plant in _IN_MESSAGES.items():
        for k, entry in enumerate(getattr(settings, kind)):
            if entry.log == log:
                rng = stream(seed, f"surrogate/{log}/planted/{kind}/{k}")
                record, defect = plant(record, entry, Scope(epoch_ns, rng))
                found.append(defect)
    return record, found


def plant_in_stamps(
    record: Record, stamped: Record, settings: PlantedDefects, log: int, epoch_ns: int
) -> tuple[Record, list[Planted]]:
    """Plant what is in the clocks: `stamped` is the record as the file has it so far."""
    found = []
    clocks = {"log": ("arrived_ns",), "publish": ("taken_ns",), "both": ("arrived_ns", "taken_ns")}
    for drift in (entry for entry in settings.clock_drift if entry.log == log):
        at = at_point(record, drift)
        for name in clocks[drift.clock]:
            elapsed = getattr(record, name) - epoch_ns
            gained = np.rint(elapsed * (drift.ppm * 1e-6)).astype(np.int64)
            stamped = replace(stamped, **{name: getattr(stamped, name) + at * gained})
        found.append(Planted("clock_drift", drift.model_dump(), record.number[at]))
    for frozen in (entry for entry in settings.frozen_clock if entry.log == log):
        at = in_stretch(record, frozen, epoch_ns)
        for name in clocks[frozen.clock]:
            stamps = getattr(stamped, name).copy()
            if at.any():
                stamps[at] = stamps[at][np.argmin(record.taken_ns[at])]
            stamped = replace(stamped, **{name: stamps})
        found.append(Planted("frozen_clock", frozen.model_dump(), record.number[at]))
    return stamped, found


def places(found: list[Planted], record: Record, topics: list[str]) -> list[dict[str, Any]]:
    """Tell each defect with its places in the stamps of the file, JSON-able."""
    where = np.full(int(record.number.max(initial=-1)) + 1, -1)
    where[record.number] = np.arange(len(record.number))

    def tell(numbers: Index, each: bool) -> list[dict[str, Any]]:
        rows = where[numbers[numbers < len(where)]]
        kept = record.rows(rows[rows >= 0])  # a later defect may have taken a message out
        if each:
            return [{"topic": topics[kept.topic[k]], **_message(kept, k)} for k in range(len(kept.number))]
        told = []
        for topic in np.unique(kept.topic):
            mine = kept.rows(kept.topic == topic)
            first, last = int(np.argmin(mine.sequence)), int(np.argmax(mine.sequence))
            told.append(
                {
                    "topic": topics[topic],
                    "messages": len(mine.number),
                    "first": _message(mine, first),
                    "last": _message(mine, last),
                }
            )
        return told

    return [
        {"defect": defect.kind, "settings": defect.settings, "places": tell(defect.numbers, defect.each)}
        | {name: tell(numbers, defect.each) for name, numbers in defect.more.items()}
        for defect in found
    ]


def _message(record: Record, k: int) -> dict[str, int]:
    return {
        "sequence": int(record.sequence[k]),
        "publish_time_ns": int(record.taken_ns[k]),
        "log_time_ns": int(record.arrived_ns[k]),
    }


def _resistance(record: Record, entry: planted.OtherResistance, _: Scope) -> tuple[Record, Planted]:
    rows = at_point(record, entry)
    voltage = np.round((record.signal("voltage") + entry.extra_ohm * record.signal("current"))[rows], 9)
    defect = Planted("resistance", entry.model_dump(), record.number[rows])
    return record.with_values(rows, "voltage", voltage), defect


def _seam(record: Record, entry: planted.Seam, scope: Scope) -> tuple[Record, Planted]:
    at = scope.epoch_ns + round(entry.at_s * 1e3) * MS
    skip = round(entry.skip_s * 1e3) * MS
    record = record.rows((record.taken_ns < at) | (record.taken_ns >= at + skip))
    second = record.taken_ns >= at
    values = record.values.copy()
    for name in ("gap_mm", "set_point_mm"):
        moved = values[second, record.column[name]] + 1e3 * entry.gap_step_m
        values[second, record.column[name]] = np.round(moved, 9)
    sequence = record.sequence.copy()
    last, first = [], []
    for topic in np.unique(record.topic):
        mine = second & (record.topic == topic)
        sequence[mine] -= sequence[mine].min(initial=np.iinfo(np.int64).max)
        before, after = (np.flatnonzero(rows & (record.topic == topic)) for rows in (~second, second))
        if len(before) and len(after):
            last.append(record.number[before[np.argmax(record.sequence[before])]])
            first.append(record.number[after[np.argmin(record.sequence[after])]])
    record = replace(
        record,
        values=values,
        sequence=sequence,
        taken_ns=record.taken_ns - second * skip,
        arrived_ns=record.arrived_ns - second * skip,
    )
    more = {"last_before": np.array(last, dtype=np.int64)}
    defect = Planted("seam", entry.model_dump(), np.array(first, dtype=np.int64), each=True, more=more)
    return record.in_order(), defect


def _duplicated_block(record: Record, entry: planted.DuplicatedBlock, scope: Scope) -> tuple[Record, Planted]:
    later = scope.epoch_ns + round(entry.again_s * 1e3) * MS
    values = record.values.copy()
    sources, copies = [], []
    following = by_topic_in_time(record, at_point(record, entry) & (record.taken_ns >= later))
    by_topic = {int(record.topic[rows[0]]): rows for rows in following}
    for block in by_topic_in_time(record, in_stretch(record, entry, scope.epoch_ns)):
        again = by_topic.get(int(record.topic[block[0]]), block[:0])[: len(block)]
        source = block[: len(again)]
        rows, which = with_repeats(record, again)
        values[rows] = record.values[source][which]
        sources.append(record.number[source])
        copies.append(record.number[rows])
    numbers, original = (np.concatenate([np.empty(0, np.int64), *parts]) for parts in (copies, sources))
    defect = Planted("duplicated_block", entry.model_dump(), numbers, more={"original": original})
    return replace(record, values=values), defect


def _stuck(record: Record, entry: planted.StuckSensor, scope: Scope) -> tuple[Record, Planted]:
    rows = in_stretch(record, entry, scope.epoch_ns)
    for mine in by_topic_in_time(record, rows):
        record = record.with_values(mine, entry.signal, float(record.signal(entry.signal)[mine[0]]))
    return record, Planted("stuck", entry.model_dump(), record.number[rows])


def _spikes(record: Record, entry: planted.Spikes, scope: Scope) -> tuple[Record, Planted]:
    rows, _ = with_repeats(record, _drawn(record, entry, scope))
    spiked = np.round(record.signal(entry.signal)[rows] + entry.size, 9)
    defect = Planted("spikes", entry.model_dump(), record.number[rows], each=True)
    return record.with_values(rows, entry.signal, spiked), defect


def _drawn(record: Record, entry: Any, scope: Scope) -> Index:
    """Draw `count` of the messages of a stretch at each point, in order of arrival."""
    drawn = [
        scope.rng.choice(mine, min(entry.count, len(mine)), replace=False)
        for mine in by_topic_in_time(record, in_stretch(record, entry, scope.epoch_ns))
    ]
    return np.sort(np.concatenate([np.empty(0, np.int64), *drawn]))


def _saturated(record: Record, entry: planted.SaturatedSensor, _: Scope) -> tuple[Record, Planted]:
    signal = record.signal(entry.signal)
    rows = at_point(record, entry) & ((signal < entry.low) | (signal > entry.high))
    record = record.with_values(rows, entry.signal, np.clip(signal[rows], entry.low, entry.high))
    return record, Planted("saturated", entry.model_dump(), record.number[rows], each=True)


def _coarse(record: Record, entry: planted.CoarseQuantum, _: Scope) -> tuple[Record, Planted]:
    rows = at_point(record, entry)
    steps = np.round(np.rint(record.signal(entry.signal)[rows] / entry.quantum) * entry.quantum, 9) + 0.0
    return record.with_values(rows, entry.signal, steps), Planted("coarse", entry.model_dump(), record.number[rows])


def _not_a_number(record: Record, entry: planted.NotANumber, scope: Scope) -> tuple[Record, Planted]:
    rows = in_stretch(record, entry, scope.epoch_ns)
    defect = Planted("not_a_number", entry.model_dump(), record.number[rows])
    return record.with_values(rows, entry.signal, np.nan), defect


def _time_conflicts(record: Record, entry: planted.TimeConflicts, scope: Scope) -> tuple[Record, Planted]:
    rows = _drawn(record, entry, scope)
    new = record.rows(rows)
    new = new.with_values(np.arange(len(rows)), entry.signal, np.round(new.signal(entry.signal) + entry.size, 9))
    number = record.number.max(initial=-1) + 1 + np.arange(len(rows))
    new = replace(new, arrived_ns=new.arrived_ns + MS, number=number)
    return record.with_more(new).in_order(), Planted("time_conflicts", entry.model_dump(), number, each=True)


def _wrong_unit(record: Record, entry: planted.WrongUnit, _: Scope) -> tuple[Record, Planted]:
    rows = at_point(record, entry)
    scaled = np.round(record.signal(entry.signal)[rows] * entry.factor, 12)
    defect = Planted("wrong_unit", entry.model_dump(), record.number[rows])
    return record.with_values(rows, entry.signal, scaled), defect


_IN_MESSAGES: Mapping[str, Any] = {
    "resistance": _resistance,
    "seam": _seam,
    "duplicated_block": _duplicated_block,
    "stuck": _stuck,
    "spikes": _spikes,
    "saturated": _saturated,
    "coarse": _coarse,
    "not_a_number": _not_a_number,
    "time_conflicts": _time_conflicts,
    "wrong_unit": _wrong_unit,
}
