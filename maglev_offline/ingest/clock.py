"""Which clock tells a message's time, where it was reset, and the order of the messages in time."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.columns import NO_TIME, ChannelColumns
from maglev_offline.logs.signals import Clock

NS_PER_MS = 1_000_000

Times = NDArray[np.int64]

_FARTHEST_NS = 2**62


def choose(columns: ChannelColumns, clock: Clock) -> Times:
    """Return the messages' times by the chosen clock, shape [n], ns; `NO_TIME` where a header has no stamp.

    Where a sender left the publish time at 0, the log time stands in, as the MCAP specification has it. A time that is
    146 years or more away from 1970 is no time either: differences of two such do not fit into 64 bits.
    """
    if clock == "header":
        if columns.clock_ns is None:
            raise ValueError("the header clock was not read")
        times = columns.clock_ns
    elif clock == "publish_time":
        unset = columns.publish_time_ns == 0
        times = columns.publish_time_ns
        times = np.where(unset, columns.log_time_ns, times) if unset.any() else times
    else:
        times = columns.log_time_ns
    far = (times > _FARTHEST_NS) | (times < -_FARTHEST_NS)
    return np.where(far, NO_TIME, times) if far.any() else times


def epochs(t_ns: Times, reorder_ns: int) -> NDArray[np.int32]:
    """Number the stretches between resets of the clock: a message earlier than the latest one before it by more
    than `reorder_ns` begins a new epoch. Shape [n], in file order, from 0.

    The latest message before it is that of the same epoch, so that a message which is late by less is never taken
    for a reset however many are late in a row.
    """
    resets = np.zeros(len(t_ns), dtype=np.int32)
    start, window = 0, 256
    latest = t_ns[0] if len(t_ns) else 0
    # One turn for each reset, or for each window that has none; windows grow, so that the work stays linear.
    while start < len(t_ns):
        part = t_ns[start : start + window]
        running = np.maximum(np.maximum.accumulate(part), latest)
        back = np.flatnonzero(part < running - reorder_ns)
        if len(back) == 0:
            latest = running[-1]
            start += len(part)
            window *= 2
            continue
        begin = start + int(back[0])
        resets[begin] = 1
        start, window, latest = begin, 256, t_ns[begin]
    return np.cumsum(resets, dtype=np.int32)


def time_order(t_ns: Times, epoch: NDArray[np.int32]) -> NDArray[np.intp]:
    """Indices that sort messages by epoch, then time; messages of one time stay in file order. Shape [n]."""
    return np.lexsort((np.arange(len(t_ns)), t_ns, epoch))


def steps_of(t_ns: Times) -> tuple[float | None, float | None, float | None]:
    """Median, jitter and greatest of the steps between times in order, ns; None without a step.

    The jitter is the standard deviation of those steps that lie within half of the median about it: pauses and holes
    are no jitter.
    """
    steps = np.diff(t_ns).astype(np.float64)
    if len(steps) == 0:
        return None, None, None
    median = np.median(steps)
    near = steps[np.abs(steps - median) <= 0.5 * median]
    return float(median), float(np.std(near)), float(np.max(steps))
