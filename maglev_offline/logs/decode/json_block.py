"""JSON payloads alone in a buffer of their own: each on a line, everything between them blank."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.decode.payloads import Payloads

Positions = NDArray[np.int64]
Flags = NDArray[np.bool_]

BLOCK_BYTES = 1024 * 1024
"""Arrays of this size stay in the processor's caches."""

_BLANK, _NEWLINE = ord(" "), ord("\n")


class Block:
    """The text [bytes] of n payloads, and where each begins and ends in it.

    The lines are in the order of the rows, do not overlap, and at least `room` blanks follow the last.
    """

    def __init__(self, payloads: Payloads, room: int) -> None:
        start, length = payloads.start, payloads.length
        gaps = start[1:] - start[:-1] - length[:-1]
        gap = int(gaps[0]) if len(gaps) else 1
        if 1 <= gap <= 255 and (gaps == gap).all():
            first = int(start[0])
            self.start: Positions = start - first
            self.end: Positions = self.start + length
            self.text: NDArray[np.uint8] = np.empty(int(self.end[-1]) + 1 + room, dtype=np.uint8)
            self.text[: self.end[-1]] = payloads.data[first : first + self.end[-1]]
            blanks = np.dtype(f"V{gap}")
            places = np.ndarray((len(self.text) - gap + 1,), blanks, self.text, strides=(1,))
            places[self.end[:-1]] = np.void(b"\n" + b" " * (gap - 1))
        else:
            pieces = np.ascontiguousarray(payloads.data).data
            lines = b"\n".join([pieces[a:b] for a, b in zip(start.tolist(), (start + length).tolist(), strict=True)])
            self.end = np.cumsum(length + 1) - 1
            self.start = self.end - length
            self.text = np.empty(len(lines) + 1 + room, dtype=np.uint8)
            self.text[: len(lines)] = np.frombuffer(lines, dtype=np.uint8)
        self.text[self.end[-1]] = _NEWLINE
        self.text[self.end[-1] + 1 :] = _BLANK

    def __len__(self) -> int:
        return len(self.start)

    def rows_at(self, places: Positions) -> Flags:
        """The rows [n] in which at least one of these places of the text lies."""
        rows = np.searchsorted(self.start, places, "right") - 1
        inside = rows >= 0
        inside &= places < self.end[rows]
        found = np.zeros(len(self), dtype=np.bool_)
        found[rows[inside]] = True
        return found

    def counts(self, places: Positions) -> tuple[Positions, Positions]:
        """For ascending places in the text: the first that lies in each row [n], and how many lie in it [n]."""
        first = np.searchsorted(places, self.start)
        return first, np.searchsorted(places, self.end) - first

    def not_utf8(self) -> Flags:
        """The rows [n] that no strict decoder of UTF-8 is sure to take."""
        try:
            # Each row is followed by a newline: where the whole is valid, so is every row.
            str(self.text.data, "utf-8")
        except UnicodeDecodeError:
            return self.rows_at(np.flatnonzero(self.text >= 0x80))
        return np.zeros(len(self), dtype=np.bool_)


def in_bounds(payloads: Payloads) -> bool:
    """Whether every payload lies within the data."""
    start, length = payloads.start, payloads.length
    return bool(((start >= 0) & (length >= 0) & (start <= len(payloads.data) - length)).all())


def slices(payloads: Payloads, block_bytes: int = BLOCK_BYTES) -> Iterator[tuple[int, int]]:
    """Consecutive rows in slices of about `block_bytes` of payload, as first row and row after the last."""
    filled = np.cumsum(payloads.length)
    first = 0
    while first < len(payloads):
        before = int(filled[first - 1]) if first else 0
        last = max(first + 1, int(np.searchsorted(filled, before + block_bytes, "right")))
        yield first, last
        first = last


def part(payloads: Payloads, rows: slice | Positions) -> Payloads:
    """Some of the payloads."""
    return Payloads(payloads.data, payloads.start[rows], payloads.length[rows])
