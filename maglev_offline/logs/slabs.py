"""Decoded messages on their way from the file to the samples: slabs of bounded size, in memory or on disk.

A slab holds the messages of a stretch of the file, sorted by topic, each topic in file order. Where the log is large,
slabs wait on disk, since a topic can be checked only when all of its messages are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

ROWS = 2**14
"""A slab is closed once it holds so many messages: its columns are sorted while they lie in the processor's cache."""

LOG_TIME, PUBLISH_TIME, SEQUENCE, FILE_INDEX, STAMP = range(5)
"""Rows of `Piece.integers`; the last one is there only where a stamp is wanted."""


class Piece(NamedTuple):
    """Some messages in file order, n of them, as few arrays as can be: there are many pieces, and each costs its calls.

    `integers` [4 or 5, n] int64, `values` [paths, n] float64, `decoded` [n].
    """

    integers: NDArray[np.int64]
    values: NDArray[np.float64]
    decoded: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.decoded)

    def take(self, rows: NDArray[np.intp] | slice) -> "Piece":
        """Some of its messages; all rows must be there."""
        if isinstance(rows, slice):
            return Piece(self.integers[:, rows], self.values[:, rows], self.decoded[rows])
        # A third of the time of indexing with the rows.
        integers = self.integers.take(rows, axis=1, mode="clip")
        return Piece(integers, self.values.take(rows, axis=1, mode="clip"), self.decoded[rows])

    def copy(self) -> "Piece":
        """The same messages in memory of their own."""
        return Piece(self.integers.copy(), self.values.copy(), self.decoded.copy())

    @property
    def row_bytes(self) -> int:
        """Bytes of one message."""
        return bytes_of_row(len(self.integers), len(self.values))


def bytes_of_row(integers: int, values: int) -> int:
    """Bytes of a message with so many integers and values."""
    return 8 * (integers + values) + 1


def _laid_over(memory: bytes, n: int, integers: int, values: int) -> Piece:
    """A piece of n messages in bytes: its integers, then its values, then whether they were decoded."""
    behind = 8 * n * integers
    return Piece(
        np.frombuffer(memory, np.int64, n * integers).reshape(integers, n),
        np.frombuffer(memory, np.float64, n * values, behind).reshape(values, n),
        np.frombuffer(memory, np.bool_, n, behind + 8 * n * values),
    )


def join_pieces(pieces: Sequence[Piece]) -> Piece:
    """Consecutive pieces as one; there must be at least one."""
    if len(pieces) == 1:
        return pieces[0]
    integers, values, decoded = zip(*pieces, strict=True)
    return Piece(np.concatenate(integers, axis=1), np.concatenate(values, axis=1), np.concatenate(decoded))


Cut = tuple[Piece, int, int]
"""Some messages of a piece: the first one, and the one behind the last."""


def join_cuts(cuts: Sequence[Cut]) -> Piece:
    """Consecutive cuts as one piece; no copy where they lie side by side. There must be at least one."""
    whole, first, stop = cuts[0]
    for piece, its_first, its_stop in cuts[1:]:
        if piece is not whole or its_first != stop:
            return join_pieces([piece.take(slice(a, b)) for piece, a, b in cuts])
        stop = its_stop
    return whole.take(slice(first, stop))


class Slab(Protocol):
    """Messages of a stretch of the file. `counts` has the messages of each topic in it."""

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic; a topic without any is not in it."""

    def cut(self, topic: str, files: "Files") -> Cut | None:
        """The messages of one topic, `FILE_INDEX` counted from the stretch's first; None where the slab has none."""


class Files:
    """Files that slabs wait in, each opened once while many slabs are read; a context manager."""

    def __init__(self) -> None:
        self._open: dict[Path, BinaryIO] = {}

    def read(self, path: Path, offset: int, size: int) -> bytes:
        """Some bytes of a file."""
        if path not in self._open:
            self._open[path] = path.open("rb", buffering=0)
        file = self._open[path]
        file.seek(offset)
        return file.read(size)

    def __enter__(self) -> "Files":
        return self

    def __exit__(self, *_: object) -> None:
        for file in self._open.values():
            file.close()


@dataclass(frozen=True)
class MemorySlab:
    """A slab at hand."""

    topics: dict[str, Cut]

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic."""
        return {topic: stop - first for topic, (_, first, stop) in self.topics.items()}

    def cut(self, topic: str, files: Files) -> Cut | None:  # noqa: ARG002
        """The messages of one topic."""
        return self.topics.get(topic)

    def spill(self, file: BinaryIO) -> "DiskSlab":
        """Append the slab to a file of its owner's."""
        places: dict[str, tuple[int, int, int, int]] = {}
        parts: list[memoryview] = []
        at = file.tell()
        for topic, (whole, first, stop) in self.topics.items():
            places[topic] = (at, stop - first, len(whole.integers), len(whole.values))
            parts += [np.ascontiguousarray(array[..., first:stop]).data for array in whole]
            at += (stop - first) * whole.row_bytes
        file.write(b"".join(parts))
        return DiskSlab(Path(file.name), places)


@dataclass(frozen=True)
class DiskSlab:
    """A slab in a file: for each topic its offset, and the numbers of messages, of `integers` and of `values`."""

    path: Path
    places: dict[str, tuple[int, int, int, int]]

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic."""
        return {topic: n for topic, (_, n, _, _) in self.places.items()}

    def cut(self, topic: str, files: Files) -> Cut | None:
        """The messages of one topic."""
        if topic not in self.places:
            return None
        offset, n, integers, values = self.places[topic]
        data = files.read(self.path, offset, n * bytes_of_row(integers, values))
        return _laid_over(data, n, integers, values), 0, n


def by_topic(piece: Piece, topic_of_row: NDArray[np.uint16], topics: Sequence[str]) -> MemorySlab:
    """Sort messages of several topics, whose number each row tells, into a slab."""
    if len(topics) == 1:
        return MemorySlab({topics[0]: (piece, 0, len(piece))})
    arranged = piece.take(np.argsort(topic_of_row, kind="stable"))
    ends = np.cumsum(np.bincount(topic_of_row, minlength=len(topics))).tolist()
    spans = zip(topics, [0, *ends], ends, strict=False)
    return MemorySlab({topic: (arranged, first, stop) for topic, first, stop in spans if stop > first})
