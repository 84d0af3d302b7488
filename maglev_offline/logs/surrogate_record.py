"""The messages of a surrogate log while they are made, and how to take some of them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

MS = 1_000_000
"""Nanoseconds in a millisecond."""

FIELD_OF_SIGNAL = {
    "gap": "gap_mm",
    "gap_velocity": "gap_velocity_mm_s",
    "current": "coil_current_a",
    "voltage": "coil_voltage_v",
    "set_point": "set_point_mm",
}


@dataclass(frozen=True)
class Record:
    """Messages in order of arrival, n of them; `number` [n] names each for good, `column` tells a field's column.

    The times are true ones, until `stamped` has the file's.
    """

    topic: Index
    arrived_ns: Index
    taken_ns: Index
    sequence: Index
    values: Array
    number: Index
    column: Mapping[str, int]

    def rows(self, rows: Mask | Index) -> "Record":
        """Some of the messages."""
        return Record(
            self.topic[rows],
            self.arrived_ns[rows],
            self.taken_ns[rows],
            self.sequence[rows],
            self.values[rows],
            self.number[rows],
            self.column,
        )

    def with_more(self, other: "Record") -> "Record":
        """These messages and then the others."""
        return Record(
            np.concatenate([self.topic, other.topic]),
            np.concatenate([self.arrived_ns, other.arrived_ns]),
            np.concatenate([self.taken_ns, other.taken_ns]),
            np.concatenate([self.sequence, other.sequence]),
            np.concatenate([self.values, other.values]),
            np.concatenate([self.number, other.number]),
            self.column,
        )

    def in_order(self) -> "Record":
        """The messages in order of arrival."""
        return self.rows(np.lexsort((self.topic, self.arrived_ns)))

    def with_values(self, rows: Mask | Index, signal: str, new: Array | float) -> "Record":
        """The record with other values of a signal."""
        values = self.values.copy()
        values[rows, self.column[FIELD_OF_SIGNAL[signal]]] = new
        return replace(self, values=values)

    def signal(self, signal: str) -> Array:
        """Values of a signal, shape [n]."""
        found: Array = self.values[:, self.column[FIELD_OF_SIGNAL[signal]]]
        return found


def at_point(record: Record, entry: Any) -> Mask:
    """Which messages are of the entry's point, shape [n]."""
    found: Mask = record.topic == entry.point if entry.point is not None else np.ones(len(record.topic), dtype=np.bool_)
    return found


def in_stretch(record: Record, entry: Any, epoch_ns: int) -> Mask:
    """Which messages of the entry's point were taken in its stretch, shape [n]."""
    start = epoch_ns + round(entry.start_s * 1e3) * MS
    stop = start + round(entry.duration_s * 1e3) * MS
    found: Mask = at_point(record, entry) & (record.taken_ns >= start) & (record.taken_ns < stop)
    return found


def by_topic_in_time(record: Record, rows: Mask) -> list[Index]:
    """The messages of each topic in order of the time at which the sensor was read, each once where it was repeated."""
    order = np.argsort(record.taken_ns, kind="stable")
    order = order[rows[order]]
    found = []
    for topic in np.unique(record.topic[order]):
        mine = order[record.topic[order] == topic]
        _, first = np.unique(np.stack([record.taken_ns[mine], record.sequence[mine]]), axis=1, return_index=True)
        found.append(mine[np.sort(first)])
    return found


def with_repeats(record: Record, rows: Index) -> tuple[Index, Index]:
    """All messages that are these or repeat one of them, in order of arrival, and for each which of `rows` it is."""
    columns = np.stack([record.topic, record.sequence, record.taken_ns])
    _, kind = np.unique(columns, axis=1, return_inverse=True)
    place = np.full(int(kind.max(initial=-1)) + 1, -1)
    place[kind[rows]] = np.arange(len(rows))
    of = place[kind]
    return np.flatnonzero(of >= 0), of[of >= 0]
