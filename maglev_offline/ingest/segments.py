"""Stretches without a hole: of one topic, and those that the topics of a point have in common."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Stretches:
    """Stretches of one topic, m of them: messages [first, stop) of the topic, in time order, ends included.

    `epoch` is the epoch of each; `file_first` and `file_last` are the places in the file that this epoch spans. All of
    shape [m]. `epochs` is how many epochs the topic has.
    """

    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    start_ns: NDArray[np.int64]
    end_ns: NDArray[np.int64]
    epoch: NDArray[np.int64]
    file_first: NDArray[np.int64]
    file_last: NDArray[np.int64]
    epochs: int

    def __len__(self) -> int:
        return len(self.first)


@dataclass(frozen=True)
class Common:
    """Stretches that several topics have in common, m of them: time span, and each topic's own stretch.

    `start_ns` and `end_ns` have shape [m], `parts` has shape [m, topics]. `era_first` to `era_last` is what tells times
    before a reset from the same times after it, see `eras_of`.
    """

    start_ns: NDArray[np.int64]
    end_ns: NDArray[np.int64]
    era_first: NDArray[np.int64]
    era_last: NDArray[np.int64]
    parts: NDArray[np.int64]


def stretch_of(t_ns: NDArray[np.int64], epoch: NDArray[np.int32], longest_bridge_ns: int) -> NDArray[np.int64]:
    """Number the stretches of messages in time order: a longer silence, or a new epoch, begins another. Shape [n]."""
    if len(t_ns) == 0:
        return np.empty(0, dtype=np.int64)
    # Unsigned, so that the step between the two ends of what an int64 holds is no negative one.
    step = t_ns[1:].view(np.uint64) - t_ns[:-1].view(np.uint64)
    new = (step > longest_bridge_ns) | (epoch[1:] != epoch[:-1])
    return np.concatenate([[0], np.cumsum(new)])


def lone(stretch: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Messages that are alone in their stretch, shape [n]."""
    if len(stretch) == 0:
        return np.empty(0, dtype=np.bool_)
    if len(stretch) > 1 and stretch[-1] == stretch[0]:
        return np.zeros(len(stretch), dtype=np.bool_)
    alone: NDArray[np.bool_] = np.bincount(stretch)[stretch] == 1
    return alone


def stretches(
    t_ns: NDArray[np.int64],
    stretch: NDArray[np.int64],
    epoch: NDArray[np.int32],
    file_index: NDArray[np.int64],
) -> Stretches:
    """Collect the stretches of messages in time order (no lone ones left among them)."""
    n = len(t_ns)
    if n == 0:
        nothing = np.empty(0, dtype=np.int64)
        return Stretches(nothing, nothing, nothing, nothing, nothing, nothing, nothing, epochs=1)
    first = np.flatnonzero(np.concatenate([[True], stretch[1:] != stretch[:-1]]))
    stop = np.append(first[1:], n)
    # Epochs ascend, so each is a run.
    runs = np.flatnonzero(np.concatenate([[True], epoch[1:] != epoch[:-1]]))
    run = np.searchsorted(runs, first, side="right") - 1
    return Stretches(
        first,
        stop,
        t_ns[first],
        t_ns[stop - 1],
        epoch[first].astype(np.int64),
        np.minimum.reduceat(file_index, runs)[run],
        np.maximum.reduceat(file_index, runs)[run],
        epochs=int(epoch[-1]) + 1,
    )


def in_common(topics: list[Stretches]) -> Common:
    """Intersect the stretches of the topics of one point, in order of the first topic's.

    Stretches meet where their times do and they belong to the same era: after a reset the same times come again, and
    must not be paired with those from before it.
    """
    eras = eras_of(topics)
    head = topics[0]
    common = Common(head.start_ns, head.end_ns, *eras[0], np.arange(len(head), dtype=np.int64)[:, None])
    for other, era in zip(topics[1:], eras[1:], strict=True):
        common = _meet(common, other, *era)
    return common


Era = tuple[NDArray[np.int64], NDArray[np.int64]]


def eras_of(topics: list[Stretches]) -> list[Era]:
    """First and last number of the era of each stretch; two stretches are of one era where these overlap.

    Topics with as many epochs as each other were reset together, and the number of the epoch is the era. Otherwise
    it is what the epoch spans in the file, and a topic that was never reset belongs to every era.
    """
    if len({topic.epochs for topic in topics}) == 1:
        return [(topic.epoch, topic.epoch) for topic in topics]
    return [
        (topic.file_first, topic.file_last)
        if topic.epochs > 1
        else (np.zeros(len(topic), dtype=np.int64), np.full(len(topic), np.iinfo(np.int64).max))
        for topic in topics
    ]


def _meet(common: Common, other: Stretches, era_first: NDArray[np.int64], era_last: NDArray[np.int64]) -> Common:
    mine: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]
    theirs: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]
    # Stretches of one epoch ascend and do not overlap, so those that meet a span are a range of them.
    begins = np.flatnonzero(np.concatenate([[True], other.epoch[1:] != other.epoch[:-1]])[: len(other)])
    for begin, end in zip(begins, np.append(begins[1:], len(other)), strict=False):
        ours = np.flatnonzero((common.era_last >= era_first[begin]) & (common.era_first <= era_last[begin]))
        low = np.searchsorted(other.end_ns[begin:end], common.start_ns[ours], side="left")
        high = np.searchsorted(other.start_ns[begin:end], common.end_ns[ours], side="right")
        many = np.maximum(high - low, 0)
        mine.append(np.repeat(ours, many))
        theirs.append(np.repeat(low + begin - (np.cumsum(many) - many), many) + np.arange(many.sum()))
    a, b = np.concatenate(mine), np.concatenate(theirs)
    order = np.lexsort((b, a))
    a, b = a[order], b[order]
    return Common(
        np.maximum(common.start_ns[a], other.start_ns[b]),
        np.minimum(common.end_ns[a], other.end_ns[b]),
        np.maximum(common.era_first[a], era_first[b]),
        np.minimum(common.era_last[a], era_last[b]),
        np.column_stack([common.parts[a], b]),
    )
