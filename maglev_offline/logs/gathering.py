"""Memory for all messages of each topic at once, where a log says how many there are and they fit.

Slabs then become cuts of it that lie side by side, so that joining them costs nothing.
"""

from collections.abc import Mapping

import numpy as np

from maglev_offline.logs.slabs import Cut, MemorySlab, Piece


class Gathering:
    """Takes slabs in the order of the file.

    `expected`: messages by topic; a topic that exceeds it keeps its slabs. `most_bytes`: what is claimed beyond that
    gets no memory here, since a log may claim any number.
    """

    def __init__(self, expected: Mapping[str, int], most_bytes: int) -> None:
        self._expected, self._most_bytes = expected, most_bytes
        self._bytes = np.empty(0, dtype=np.uint8)
        self._used = 0
        self._topics: dict[str, tuple[Piece, int]] = {}

    def take_in(self, slab: MemorySlab) -> MemorySlab:
        """Copy what there is room for; return the same slab as cuts of the copies."""
        return MemorySlab({topic: self._one(topic, *cut) for topic, cut in slab.topics.items()})

    def _one(self, topic: str, piece: Piece, first: int, stop: int) -> Cut:
        if topic not in self._topics:
            self._topics[topic] = (self._room(topic, piece), 0)
        room, at = self._topics[topic]
        end = at + stop - first
        if end > len(room):
            return (piece.take(slice(first, stop)).copy(), 0, stop - first)
        for mine, its in zip(room, piece, strict=True):
            mine[..., at:end] = its[..., first:stop]
        self._topics[topic] = (room, end)
        return (room, at, end)

    def _room(self, topic: str, like: Piece) -> Piece:
        if len(self._bytes) == 0:
            wanted = sum(self._expected.values()) * like.row_bytes + 8 * len(self._expected)
            # numpy asks for so much in large pages: a fault for 2 MiB, not for 4 KiB.
            self._bytes = np.empty(min(wanted, self._most_bytes), dtype=np.uint8)
        count = self._expected.get(topic, 0)
        size = -(-count * like.row_bytes // 8) * 8
        if size > len(self._bytes) - self._used:
            count = size = 0
        mine = self._bytes[self._used : self._used + size]
        self._used += size
        return like.laid_over(mine, count)
