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
        self._expected, self._left = expected, most_bytes
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
        count = self._expected.get(topic, 0)
        if count * like.row_bytes > self._left:
            count = 0
        self._left -= count * like.row_bytes
        # One block for each topic: numpy asks for a single large one in large pages, and the system takes its time to
        # find these.
        return Piece(*(np.empty((*array.shape[:-1], count), dtype=array.dtype) for array in like))
