"""What disqualifies a single message. Each check returns the messages that it finds; their codes are stable."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.columns import NO_TIME
from maglev_offline.logs.signals import UNIT_OF_SIGNAL

NOT_DECODABLE = "not_decodable"
"""The payload could not be read."""
NO_STAMP = "no_time"
"""The clock's field is missing."""
NOT_FINITE = "not_finite"
"""A signal is missing, no number, NaN or infinite."""
OUT_OF_RANGE = "out_of_range"
"""A signal lies outside the range that the recipe declares valid."""
REPEATED = "repeated_message"
"""The same time and the same values as the message before it."""
TIME_CONFLICT = "time_conflict"
"""The same time as an earlier message, other values; the earlier one was kept."""
TOO_SHORT = "too_short"
"""The stretch that it lies in holds one message only, or no grid instant."""
NO_PARTNER = "no_partner"
"""The point's other topics are silent at its time."""
UNMAPPED = "unmapped_topic"
"""No point takes a signal from its topic."""
MISSING = "missing"
"""The log's statistics count it, and it is nowhere in the file."""

Values = Mapping[str, NDArray[np.float64]]
Mask = NDArray[np.bool_]


def not_finite(values: Values) -> dict[str, Mask]:
    """Messages in which a state signal is not finite, by signal, each of shape [n].

    A context signal alone disqualifies no message: it stays NaN in the samples. A message of a topic that carries
    only context is found (under each signal) where none of them is finite.
    """
    bad: dict[str, Mask] = {name: ~np.isfinite(column) for name, column in values.items()}
    state = {name: mask for name, mask in bad.items() if name in UNIT_OF_SIGNAL}
    if state or not bad:
        return state
    nothing: Mask = np.logical_and.reduce(list(bad.values()))
    return dict.fromkeys(bad, nothing)


def no_stamp(t_ns: NDArray[np.int64]) -> Mask:
    """Messages without a time, shape [n]."""
    missing: Mask = t_ns == NO_TIME
    return missing


def same_time(t_ns: NDArray[np.int64], epoch: NDArray[np.int32], values: Values) -> tuple[Mask, Mask]:
    """Repeated messages and time conflicts among messages in time order; the first of a time is never among them.

    Returns two masks of shape [n]: the same values as the first message of that time, and other values. NaN equals
    NaN here.
    """
    n = len(t_ns)
    first = np.ones(n, dtype=np.bool_)
    first[1:] = (t_ns[1:] != t_ns[:-1]) | (epoch[1:] != epoch[:-1])
    leader = np.maximum.accumulate(np.where(first, np.arange(n), 0))
    equal = np.ones(n, dtype=np.bool_)
    for column in values.values():
        other = column[leader]
        equal &= (column == other) | (np.isnan(column) & np.isnan(other))
    return ~first & equal, ~first & ~equal


def named(masks: Mapping[str, Mask], n: int) -> NDArray[np.str_]:
    """Names of the signals that are set for each message, joined by commas, shape [n]."""
    text = np.full(n, "", dtype="U1")
    for name, mask in masks.items():
        joint = np.where(np.strings.str_len(text) > 0, ", ", "")
        text = np.where(mask, np.strings.add(np.strings.add(text, joint), name), text)
    return text
