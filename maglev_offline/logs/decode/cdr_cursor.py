"""Reads many cdr messages of one type side by side: each step moves all of them on by one field or run of fields.

Messages that end too early, or whose lengths cannot be true, are no longer `ok`; what is read for them afterwards means
nothing, but is never outside the buffer.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.decode.cdr_plan import Layout, Numbers, Repeat, Segment, Step, String

_MOST_ELEMENTS = 4096
"""Sequences of strings and of types cost a step for each element; longer ones go to the library, row by row."""

MOST_STEPS = 50_000
"""How many steps may be taken in one go."""

_LONGEST_TEXT = 64
_MASKS = np.array([(1 << 8 * n) - 1 for n in range(8)] + [2**64 - 1], dtype="<u8") & np.uint64(0x8080808080808080)
"""The uppermost bits of the first 0 to 8 bytes of a word; ASCII has none of them."""


class Column(NamedTuple):
    """The values of one slot [n] as they are in the messages; `present` is None where every message has it."""

    raw: NDArray[Any]
    present: NDArray[np.bool_] | None


class Cursor:
    """Where n messages of one byte order have been read up to, and what was found.

    Parameters
    ----------
    data: the buffer [bytes].
    base, limit [n]: where each body begins in the buffer, and how long it is; bodies lie inside the buffer.
    order: `<` or `>`.
    """

    def __init__(self, data: NDArray[np.uint8], base: NDArray[np.int64], limit: NDArray[np.int64], order: str) -> None:
        self.data, self.base, self.limit, self.order = data, base, limit, order
        self.position = np.zeros(len(base), dtype=np.int64)
        self.ok = np.ones(len(base), dtype=np.bool_)
        self.elements = np.zeros(len(base), dtype=np.int64)
        self.columns: dict[int, Column] = {}

    def part(self, rows: NDArray[np.intp]) -> "Cursor":
        """A cursor over some of the messages, which has found nothing yet."""
        part = Cursor(self.data, self.base[rows], self.limit[rows], self.order)
        part.position, part.ok, part.elements = self.position[rows], self.ok[rows], self.elements[rows]
        return part

    def take_back(self, rows: NDArray[np.intp], part: "Cursor") -> None:
        """Go on from where a part has come to."""
        self.position[rows], self.ok[rows], self.elements[rows] = part.position, part.ok, part.elements
        for slot, (raw, present) in part.columns.items():
            column = self.columns.get(slot)
            if column is None or column.present is None:
                column = self.columns[slot] = _nothing(raw.dtype.str, len(self.base))
            column.raw[rows] = raw
            assert column.present is not None
            column.present[rows] = True if present is None else present

    def records(self, position: NDArray[np.int64], span: int) -> NDArray[np.void]:
        """The `span` bytes at a position in each body; right where they lie inside the body."""
        if len(self.data) < span:
            return np.zeros(len(self.base), dtype=np.dtype((np.void, span)))
        # One gather of whole records is many times faster than one for each field, or than numpy's structured types.
        count = len(self.data) - span + 1
        windows = np.ndarray((count,), np.dtype((np.void, span)), buffer=self.data, strides=(1,))
        found: NDArray[np.void] = windows[np.minimum(self.base + position, count - 1)]
        return found

    def values(self, position: NDArray[np.int64], code: str) -> NDArray[Any]:
        """One primitive at a position in each body."""
        return self.records(position, int(code[1:])).view(np.dtype(self.order + code))

    def lengths(self) -> NDArray[np.int64]:
        """Step over the length of a string or a sequence; 0 where the message has ended."""
        at = (self.position + 3) & -4
        self.position = at + 4
        self.ok &= self.position <= self.limit
        return np.where(self.ok, self.values(at, "u4").astype(np.int64), 0)


def advance(cursor: Cursor, steps: Sequence[Step], budget: list[int]) -> None:
    """Take the steps in turn; `budget` holds how many more there may be, whatever the messages claim."""
    budget[0] -= len(steps)
    for step in steps:
        match step:
            case Segment(layouts):
                _segment(cursor, layouts)
            case String():
                _string(cursor)
            case Numbers():
                _numbers(cursor, step)
            case Repeat():
                _repeat(cursor, step, budget)


def _segment(cursor: Cursor, layouts: Sequence[Layout]) -> None:
    phase = cursor.position & (len(layouts) - 1)
    first = int(phase[0])
    if len(layouts) == 1 or (phase == first).all():
        fetch(cursor, layouts[first])
        return

    def one(part: Cursor) -> None:
        fetch(part, layouts[int(part.position[0]) & (len(layouts) - 1)])

    for each in np.unique(phase).tolist():
        _some(cursor, phase == each, one)


def fetch(cursor: Cursor, layout: Layout) -> None:
    """Read a run of fields of fixed size, which begins in the same phase in all messages."""
    at = cursor.position
    cursor.position = at + layout.size
    cursor.ok &= cursor.position <= cursor.limit
    for first, span, fields in layout.clusters:
        records = cursor.records(at + first, span)
        for slot, offset, code in fields:
            kind = np.dtype(cursor.order + code)
            raw: NDArray[Any] = np.ndarray((len(at),), kind, buffer=records, offset=offset, strides=(span,))
            cursor.columns[slot] = Column(raw, None)


def _string(cursor: Cursor) -> None:
    length = cursor.lengths()
    at = cursor.position
    cursor.ok &= at + length <= cursor.limit
    length[~cursor.ok] = 0
    cursor.position = at + length
    # An invalid byte anywhere makes the library give up the whole message. Its last byte is never looked at.
    letters = np.maximum(length - 1, 0)
    doubtful = (letters > _LONGEST_TEXT) | (cursor.base + at + letters + 8 > len(cursor.data))
    known = np.where(doubtful, 0, letters)
    for first in range(0, int(known.max()), 8):
        words = cursor.values(at + first, "u8").view("<u8")
        doubtful |= (words & _MASKS[np.clip(known - first, 0, 8)]) != 0
    for row in np.flatnonzero(doubtful & (letters > 0)).tolist():
        begin = int(cursor.base[row] + at[row])
        try:
            cursor.data[begin : begin + int(letters[row])].tobytes().decode()
        except UnicodeDecodeError:
            cursor.ok[row] = False


def _numbers(cursor: Cursor, step: Numbers) -> None:
    count = cursor.lengths()
    # Only an element is aligned: an empty sequence ends right behind its length.
    first = np.where(count > 0, (cursor.position + step.size - 1) & -step.size, cursor.position)
    cursor.position = first + count * step.size
    cursor.ok &= cursor.position <= cursor.limit
    count[~cursor.ok] = 0
    for element, slot in step.taken:
        if element >= len(cursor.data):
            cursor.columns[slot] = _nothing(step.code, len(count))
        else:
            raw = cursor.values(first + element * step.size, step.code)
            cursor.columns[slot] = Column(raw, count > element)


def _repeat(cursor: Cursor, step: Repeat, budget: list[int]) -> None:
    count = cursor.lengths()
    # No element takes less than one byte.
    cursor.ok &= count <= cursor.limit - cursor.position
    cursor.elements += np.where(cursor.ok, count, 0)
    cursor.ok &= cursor.elements <= _MOST_ELEMENTS
    count[~cursor.ok] = 0
    for k in range(int(count.max())):
        inside = (count > k) & cursor.ok
        if budget[0] < 0:
            cursor.ok &= ~inside
        steps = step.special.get(k, step.plain)
        if not (inside & cursor.ok).any():
            break
        _some(cursor, inside, partial(advance, steps=steps, budget=budget))
    for steps in step.special.values():
        for slot, code in _slots(steps):
            if slot not in cursor.columns:
                cursor.columns[slot] = _nothing(code, len(count))


def _some(cursor: Cursor, chosen: NDArray[np.bool_], move: Callable[[Cursor], None]) -> None:
    if chosen.all():
        move(cursor)
        return
    rows = np.flatnonzero(chosen)
    part = cursor.part(rows)
    move(part)
    cursor.take_back(rows, part)


def _nothing(code: str, n: int) -> Column:
    return Column(np.zeros(n, dtype=code), np.zeros(n, dtype=np.bool_))


def _slots(steps: Sequence[Step]) -> list[tuple[int, str]]:
    """The slots that the steps fill, with their types."""
    found: list[tuple[int, str]] = []
    for step in steps:
        match step:
            case Segment(layouts):
                found += [(slot, code) for c in layouts[0].clusters for slot, _, code in c.fields]
            case Numbers(code, _, taken):
                found += [(slot, code) for _, slot in taken]
            case Repeat(_, special):
                for below in special.values():
                    found += _slots(below)
    return found
