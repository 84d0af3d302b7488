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
    """The rows of each topic in order of the time at which the sensor was read."""
    order = np.argsort(record.taken_ns, kind="stable")
    order = order[rows[order]]
    return [order[record.topic[order] == topic] for topic in np.unique(record.topic[order])]
