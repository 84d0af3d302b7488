"""A long log is checked window by window, so that memory is bounded whatever its length.

A window ends where the topics' clocks are settled: every message that could still be sorted in before its end has
come. Where there is a silence near the end, the window ends there; otherwise a segment is cut in two, which costs one
transition in 65,536.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import clock
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.columns import NO_TIME, ChannelColumns, join
from maglev_offline.logs.reader import TopicWanted, topic_columns
from maglev_offline.logs.signals import Clock
from maglev_offline.logs.slabs import Slab

MOST_MESSAGES = 2**16
"""A window holds at most about so many messages of a topic."""

_NEAR_THE_END = 2**13
"""A silence among so many last messages of a topic is preferred as the end of a window."""

Slabs = Sequence[tuple[Slab, int]]


@dataclass(frozen=True)
class Window:
    """Some consecutive slabs of a log, the first of which begins at the file index `first`.

    `index` is how many messages of each topic came before these slabs. `carried` are messages of the slabs before that
    belong here, with their places within the topic; `until_ns` is the time from which on messages are left to the next
    window, by topic (only those of the last epoch of the topic's clock).
    """

    slabs: Slabs
    first: int
    index: Mapping[str, int]
    carried: Mapping[str, tuple[ChannelColumns, NDArray[np.int64]]] = field(default_factory=dict)
    until_ns: int | None = None

    def columns(
        self, topic: str, wanted: TopicWanted, by: Clock, settings: IngestSettings
    ) -> tuple[ChannelColumns, NDArray[np.int64]]:
        """The messages of a topic in this window and the place of each within the topic, in file order."""
        columns, index = self._all(topic, wanted)
        later = self._later(columns, by, settings)
        return (columns, index) if later is None else (columns.take(~later), index[~later])

    def left_over(
        self, topic: str, wanted: TopicWanted, by: Clock, settings: IngestSettings
    ) -> tuple[ChannelColumns, NDArray[np.int64]]:
        """The messages of a topic that are left to the next window."""
        columns, index = self._all(topic, wanted)
        later = self._later(columns, by, settings)
        keep = np.zeros(len(columns), dtype=np.bool_) if later is None else later
        return columns.take(keep), index[keep]

    def _all(self, topic: str, wanted: TopicWanted) -> tuple[ChannelColumns, NDArray[np.int64]]:
        columns = topic_columns(self.slabs, topic, wanted, self.first)
        begin = self.index.get(topic, 0)
        index = np.arange(begin, begin + len(columns))
        if topic not in self.carried:
            return columns, index
        before, its_index = self.carried[topic]
        return join([before, columns]), np.concatenate([its_index, index])

    def _later(self, columns: ChannelColumns, by: Clock, settings: IngestSettings) -> NDArray[np.bool_] | None:
        if self.until_ns is None:
            return None
        times, last_epoch = _last_epoch(columns, by, settings)
        return last_epoch & (times > self.until_ns)


def windows(
    slabs: Slabs, wanted: Mapping[str, TopicWanted], by: Clock, settings: IngestSettings, most: int = MOST_MESSAGES
) -> Iterator[Window]:
    """Cut the slabs of a log into windows; a log whose topics have at most `most` messages each is one window."""
    groups = _groups(slabs, most)
    first = 0
    index: dict[str, int] = {}
    carried: dict[str, tuple[ChannelColumns, NDArray[np.int64]]] = {}
    for number, group in enumerate(groups):
        if number == len(groups) - 1:
            yield Window(group, first, index, carried)
            return
        draft = Window(group, first, index, carried)
        until_ns = _settled(draft, wanted, by, settings)
        window = Window(group, first, index, carried, until_ns)
        yield window
        carried = {topic: window.left_over(topic, one, by, settings) for topic, one in wanted.items()}
        for slab, spanned in group:
            first += spanned
            for topic, count in slab.counts.items():
                index = {**index, topic: index.get(topic, 0) + count}


def _groups(slabs: Slabs, most: int) -> list[list[tuple[Slab, int]]]:
    groups: list[list[tuple[Slab, int]]] = [[]]
    counts: dict[str, int] = {}
    for slab, spanned in slabs:
        total = {topic: counts.get(topic, 0) + n for topic, n in slab.counts.items()}
        if groups[-1] and max(total.values(), default=0) > most:
            groups.append([])
            counts, total = {}, dict(slab.counts)
        counts |= total
        groups[-1].append((slab, spanned))
    return groups


def _last_epoch(
    columns: ChannelColumns, by: Clock, settings: IngestSettings
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    times = clock.choose(columns, by)
    epoch = np.full(len(times), -1, dtype=np.int32)
    timed = times != NO_TIME
    epoch[timed] = clock.epochs(times[timed], round(settings.reorder_ms * clock.NS_PER_MS))
    return times, timed & (epoch == epoch.max(initial=0))


def _settled(window: Window, wanted: Mapping[str, TopicWanted], by: Clock, settings: IngestSettings) -> int | None:
    """The time up to which the topics that are still speaking are settled, and a silence before it if one is near."""
    reorder_ns, bridge_ns = (round(ms * clock.NS_PER_MS) for ms in (settings.reorder_ms, settings.longest_bridge_ms))
    latest: list[int] = []
    holes: list[NDArray[np.int64]] = []
    for topic, one in wanted.items():
        times, last = _last_epoch(window._all(topic, one)[0], by, settings)
        if not last.any():
            continue
        tail = np.sort(times[last])[-_NEAR_THE_END:]
        latest.append(int(tail[-1]))
        holes.append(tail[:-1][np.diff(tail) > bridge_ns])
    if not latest:
        return None
    # A topic that fell silent long ago holds nothing up: its stretch has ended.
    speaking = [t for t in latest if t >= max(latest) - max(10 * bridge_ns, 10 * reorder_ns)]
    # A message that is late by just reorder_ns is still sorted in, so that instant is not settled yet.
    until_ns = min(speaking) - reorder_ns - 1
    silences = np.concatenate(holes)
    silences = silences[silences <= until_ns]
    return int(silences.max()) if len(silences) else until_ns
