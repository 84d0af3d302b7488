"""Decoded messages on their way from the file to the samples: slabs of bounded size, in memory or on disk.

A slab holds the messages of a stretch of the file, sorted by topic, each topic in file order. Where the log is large,
slabs wait on disk, since a topic can be checked only when all of its messages are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Protocol

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.columns import ChannelColumns

ROWS = 2**14
"""A slab is closed once it holds so many messages: its columns are sorted while they lie in the processor's cache."""


class Slab(Protocol):
    """Messages of a stretch of the file. `counts` has the messages of each topic in it."""

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic; a topic without any is not in it."""

    def columns(self, topic: str) -> ChannelColumns | None:
        """The messages of one topic, `file_index` counted from the stretch's first; None where the slab has none."""


@dataclass(frozen=True)
class MemorySlab:
    """A slab whose columns are at hand; their `file_index` counts from the start of the stretch."""

    topics: dict[str, ChannelColumns]

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic."""
        return {topic: len(columns) for topic, columns in self.topics.items()}

    @property
    def nbytes(self) -> int:
        """Bytes of all its arrays."""
        return sum(array.nbytes for columns in self.topics.values() for array in columns.arrays())

    def columns(self, topic: str) -> ChannelColumns | None:
        """The messages of one topic."""
        return self.topics.get(topic)

    def spill(self, file: BinaryIO, shapes: dict[str, ChannelColumns]) -> "DiskSlab":
        """Append the slab to a file of its owner's; `shapes` is shared by the slabs of a file, and filled in."""
        places: dict[str, tuple[int, int]] = {}
        for topic, columns in self.topics.items():
            places[topic] = (file.tell(), len(columns))
            # Not slices, which would keep the arrays that they are cut from.
            if topic not in shapes:
                shapes[topic] = columns.remade([np.empty(0, dtype=array.dtype) for array in columns.arrays()])
            file.write(b"".join(np.ascontiguousarray(array).data for array in columns.arrays()))
        return DiskSlab(Path(file.name), places, shapes)


@dataclass(frozen=True)
class DiskSlab:
    """A slab in a file: for each topic its offset and number of messages, and empty columns that tell its arrays."""

    path: Path
    places: dict[str, tuple[int, int]]
    shapes: dict[str, ChannelColumns]

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic."""
        return {topic: n for topic, (_, n) in self.places.items()}

    def columns(self, topic: str) -> ChannelColumns | None:
        """The messages of one topic."""
        if topic not in self.places:
            return None
        offset, n = self.places[topic]
        kinds = [empty.dtype for empty in self.shapes[topic].arrays()]
        with self.path.open("rb") as file:
            file.seek(offset)
            data = file.read(n * sum(kind.itemsize for kind in kinds))
        arrays: list[NDArray[Any]] = []
        at = 0
        for kind in kinds:
            arrays.append(np.frombuffer(data, dtype=kind, count=n, offset=at))
            at += n * kind.itemsize
        return self.shapes[topic].remade(arrays)


def by_topic(columns: ChannelColumns, topic_of_row: NDArray[np.uint16], topics: Sequence[str]) -> MemorySlab:
    """Split columns of several topics, whose number each row tells, into a slab."""
    if len(topics) == 1:
        return MemorySlab({topics[0]: replace(columns, topic=topics[0])})
    order = np.argsort(topic_of_row, kind="stable")
    ends = np.cumsum(np.bincount(topic_of_row, minlength=len(topics))).tolist()
    arranged = columns.take(order)
    spans = zip(topics, [0, *ends], ends, strict=False)
    return MemorySlab({topic: arranged.take(slice(a, b), topic) for topic, a, b in spans if b > a})
