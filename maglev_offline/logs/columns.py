"""The messages of one topic as columns."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.decode.payloads import NO_TIME

__all__ = ["NO_TIME", "ChannelColumns", "join"]


@dataclass(frozen=True)
class ChannelColumns:
    """The messages of one topic in file order, n of them; every array has shape [n].

    `file_index` is the place among all messages of the file. `values` holds float64 by dotted path, NaN where the
    field is missing or no number. `decoded` is False where the payload could not be read at all. `clock_ns` is the
    time stamp inside the messages, `NO_TIME` where it is missing; None if no clock field was asked for. A log or
    publish time after the year 2262 is `NO_TIME`.
    """

    topic: str
    log_time_ns: NDArray[np.int64]
    publish_time_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    file_index: NDArray[np.int64]
    values: dict[str, NDArray[np.float64]]
    decoded: NDArray[np.bool_]
    clock_ns: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.log_time_ns)

    def arrays(self) -> list[NDArray[Any]]:
        """All its arrays, in an order that is always the same."""
        found: list[NDArray[Any]] = [self.log_time_ns, self.publish_time_ns, self.sequence, self.file_index]
        found += [self.decoded, *self.values.values()]
        return [*found, self.clock_ns] if self.clock_ns is not None else found

    def remade(self, arrays: Sequence[NDArray[Any]], topic: str = "") -> "ChannelColumns":
        """The same topic, or another one, with other arrays, in the order of `arrays()`."""
        log_time, publish_time, sequence, file_index, decoded, *rest = arrays
        values = dict(zip(self.values, rest, strict=False))
        clock = rest[len(self.values)] if self.clock_ns is not None else None
        return ChannelColumns(topic or self.topic, log_time, publish_time, sequence, file_index, values, decoded, clock)

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_] | slice, topic: str = "") -> "ChannelColumns":
        """Some of its messages, those of another topic if that is named."""
        return self.remade([array[rows] for array in self.arrays()], topic)


def join(parts: Sequence[ChannelColumns]) -> ChannelColumns:
    """One topic's columns from consecutive parts of them; there must be at least one."""
    if len(parts) == 1:
        return parts[0]
    return parts[0].remade([np.concatenate(arrays) for arrays in zip(*(part.arrays() for part in parts), strict=True)])
