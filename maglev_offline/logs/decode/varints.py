"""Unaligned reads and protobuf varints at many places of one buffer at once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Positions = NDArray[np.int64]

PADDING = 32
"""Bytes that must follow the last byte of a message: no read at a place within it then leaves the buffer."""

_HIGH = np.uint64(0x8080808080808080)
_ONE = np.uint64(1)
_FOLD = (
    (np.uint64(0x007F007F007F007F), np.uint64(0x7F007F007F007F00), _ONE),
    (np.uint64(0x00003FFF00003FFF), np.uint64(0x3FFF00003FFF0000), np.uint64(2)),
    (np.uint64(0x000000000FFFFFFF), np.uint64(0x0FFFFFFF00000000), np.uint64(4)),
)


class Reads:
    """Reads of any type at any byte of `data` [bytes]; a read may begin up to 8 bytes before the end."""

    def __init__(self, data: NDArray[np.uint8]) -> None:
        self._data = np.ascontiguousarray(data)
        self._views: dict[np.dtype[Any], NDArray[Any]] = {np.dtype("<u1"): self._data}

    def at(self, dtype: np.dtype[Any], pos: Positions) -> NDArray[Any]:
        """The value [n] of this type at each position [n]."""
        view = self._views.get(dtype)
        if view is None:
            # A stride of one byte: every byte begins an element.
            room = len(self._data) - dtype.itemsize + 1
            view = self._views[dtype] = np.ndarray((room,), dtype, self._data, strides=(1,))
        found: NDArray[Any] = view[pos]
        return found

    def records(self, pos: Positions, span: int) -> NDArray[np.void]:
        """The `span` bytes [n] at each position [n], all of which lie in the buffer: one gather for many fields."""
        return self.at(np.dtype((np.void, span)), pos)

    def varint(self, pos: Positions) -> tuple[NDArray[np.uint64], Positions, NDArray[np.bool_] | None]:
        """The 64-bit value [n] at each position, the position after it, and where there is no varint (or None)."""
        first = self._data[pos]
        if not (first > 0x7F).any():
            return first.astype(np.uint64), pos + 1, None
        word: NDArray[np.uint64] = self.at(np.dtype("<u8"), pos)
        stops = ~word & _HIGH
        upto: NDArray[np.uint64] = stops ^ (
            stops - _ONE
        )  # ones up to the stop bit of the first byte that ends a varint
        long = stops == 0
        value: NDArray[np.uint64] = fold(word & upto)
        after = pos + (np.bitwise_count(upto) >> 3)
        if not long.any():
            return value, after, None
        some = np.flatnonzero(long)
        ninth, tenth = self._data[pos[some] + 8].astype(np.uint64), self._data[pos[some] + 9]
        ten = ninth > 0x7F
        value[some] = fold(word[some]) | (ninth & np.uint64(0x7F)) << np.uint64(56)
        value[some[ten]] |= (tenth[ten].astype(np.uint64) & _ONE) << np.uint64(63)
        after[some] = pos[some] + 9 + ten
        bad = np.zeros(len(pos), dtype=np.bool_)
        bad[some] = ten & (tenth > 1)
        return value, after, bad


def fold(word: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Drop the top bit of each of the 8 bytes [n] and close the gaps: 56 bits."""
    for low, high, shift in _FOLD:
        word = word & low | (word & high) >> shift
    return word


def unzigzag(value: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Signed from zigzag: 0, -1, 1, -2, ..."""
    return (value >> _ONE).view(np.int64) ^ -(value & _ONE).view(np.int64)
