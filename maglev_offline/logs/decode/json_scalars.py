"""The scalars of all messages that match a template: where they stand, whether JSON allows them, and their numbers."""

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from maglev_offline.logs.decode import json_stamps
from maglev_offline.logs.decode.json_block import Block, Flags, Positions
from maglev_offline.logs.decode.json_template import Missing, Source, Template
from maglev_offline.logs.decode.payloads import NO_TIME

_LONGEST_NUMBER = 600
"""Python refuses integers from 640 digits on, or later, as it is configured."""

_WIDEST = 32
"""Constant text is compared in stretches of at most so many bytes."""

_LITERALS = (b"null", b"true", b"false", b"NaN")
"""They stand for no number."""

_NOUGHT, _MINUS, _DOT, _QUOTE, _BACKSLASH = b'0-."\\'
_LOWER, _E = 0x20, ord("e")


class Match:
    """Holds the text of messages against a template."""

    def __init__(self, template: Template) -> None:
        lengths = [len(piece) for piece in template.pieces]
        width = -(-min(max(lengths), _WIDEST) // 8) * 8
        cuts = [
            (index, at, piece[at : at + width])
            for index, piece in enumerate(template.pieces)
            for at in range(0, len(piece), width)
        ]
        self.room = max(lengths) + width
        self._after = np.array([index for index, *_ in cuts])
        self._offset = np.array([at for _, at, _ in cuts])
        self._text = np.frombuffer(b"".join(cut.ljust(width, b"\0") for *_, cut in cuts), dtype=np.uint64)
        ones = b"".join((b"\xff" * len(cut)).ljust(width, b"\0") for *_, cut in cuts)
        self._mask = np.frombuffer(ones, dtype=np.uint64)
        self._stretch = np.dtype(f"V{width}")
        self._lengths = np.array(lengths)
        # A byte 0, which no piece holds, stands for each of the scalars.
        bare = b"\0".join(template.pieces)
        # The last token ends where the message ends, but for the last piece.
        self._delimiters = sorted({piece[0] for piece in template.pieces[1:-1]})
        marks = [at for at, byte in enumerate(bare) if byte in self._delimiters]
        self._count = len(marks)
        self._ends = np.array([k for k, at in enumerate(marks) if bare[at - 1] == 0][: len(template.tokens) - 1], int)
        strings = np.array([token.is_string for token in template.tokens])
        self._strings, self._scalars = np.flatnonzero(strings), np.flatnonzero(~strings)
        marked = _special(np.frombuffer(b"".join(template.pieces), dtype=np.uint8))
        self._specials = int(np.count_nonzero(marked)) + 2 * len(self._strings)

    def read(self, block: Block) -> "Scalars":
        """Find the scalars of the messages that match."""
        rows, ends = self._delimited(block)
        starts = np.empty_like(ends)
        starts[:, 0] = block.start[rows] + self._lengths[0]
        starts[:, 1:] = ends[:, :-1] + self._lengths[1:-1]
        good = (starts < ends).all(axis=1)
        good &= self._constant(block, block.start[rows], ends)
        if len(self._strings) and good.any():
            good &= self._quoted(block, rows, starts[:, self._strings], ends[:, self._strings])
        if not good.all():
            rows, starts, ends = rows[good], starts[good], ends[good]
        if len(self._strings):
            starts, ends = starts.take(self._scalars, axis=1), ends.take(self._scalars, axis=1)
        number, allowed = _grammar(block.text, starts, ends)
        if not allowed.all():
            good = allowed.all(axis=1)
            rows, starts, ends, number = rows[good], starts[good], ends[good], number[good]
        return Scalars(block.text, rows, starts, ends, number)

    def _delimited(self, block: Block) -> tuple[NDArray[np.intp], Positions]:
        """The rows with as many delimiters as the template, and where in them the tokens would end [rows, tokens]."""
        marked = np.zeros(len(block.text), dtype=np.bool_)
        for byte in self._delimiters:
            marked |= block.text == byte
        places = np.flatnonzero(marked)
        first, count = block.counts(places)
        rows = np.flatnonzero(count == self._count)
        ends = np.empty((len(rows), len(self._ends) + 1), dtype=np.int64)
        ends[:, :-1] = places[first[rows, None] + self._ends]
        ends[:, -1] = block.end[rows] - self._lengths[-1]
        return rows, ends

    def _constant(self, block: Block, start: Positions, ends: Positions) -> Flags:
        """Where all the text between the tokens is that of the template."""
        from_place = np.column_stack((start, ends)).take(self._after, axis=1) + self._offset
        room = len(block.text) - self._stretch.itemsize + 1
        found = np.ndarray((room,), self._stretch, block.text, strides=(1,))[from_place]
        differs = found.view(np.uint64).reshape(len(start), -1)
        differs ^= self._text
        differs &= self._mask
        if not differs.any():
            return np.ones(len(start), dtype=np.bool_)
        same: Flags = ~differs.any(axis=1)
        return same

    def _quoted(self, block: Block, rows: NDArray[np.intp], starts: Positions, ends: Positions) -> Flags:
        """Where each of these tokens is a string of JSON without an escape.

        What is special in strings stands nowhere else but in the constant text: where the row has no more of it than
        the template, no string holds any.
        """
        quoted = (block.text[starts] == _QUOTE) & (block.text[ends - 1] == _QUOTE) & (ends - starts > 1)
        _, count = block.counts(np.flatnonzero(_special(block.text)))
        fine: Flags = quoted.all(axis=1) & (count[rows] == self._specials) & ~block.not_utf8()[rows]
        return fine


def _special(text: NDArray[np.uint8]) -> Flags:
    found: Flags = text == _QUOTE
    found |= text == _BACKSLASH
    found |= text < 0x20
    return found


class Scalars:
    """The scalars of the messages `rows` [n] of a block, all that are no strings; `number` [n, scalars]: no literal.

    `sure` [n] loses the rows of which a number turns out to be doubtful.

    Raises
    ------
    pa.ArrowInvalid: one of the scalars is no number after all, whether anybody wants it or not.
    """

    def __init__(
        self, text: NDArray[np.uint8], rows: NDArray[np.intp], starts: Positions, ends: Positions, number: Flags
    ) -> None:
        self.rows = rows
        self.sure: Flags = np.ones(len(rows), dtype=np.bool_)
        self._text = text
        self._starts, self._ends, self._number = starts, ends, number
        self._floats: NDArray[np.float64] = self._parse(slice(None), pa.float64()).T.copy()
        if not number.all():
            self._floats[~number.T] = np.nan
        self._times: dict[tuple[int, int], NDArray[np.int64]] = {}

    def numbers(self, source: Source) -> NDArray[np.float64]:
        """Numbers [n]; NaN where there is none."""
        if isinstance(source, tuple):
            return self._time(source).astype(np.float64) / 1e9
        if isinstance(source, Missing):
            return np.full(len(self.rows), np.nan)
        column: NDArray[np.float64] = self._floats[source]
        # Infinite is what is too large for float64, but an integer of that kind is no number.
        self.sure &= ~np.isinf(column)
        noughts = np.flatnonzero(column == 0)
        if len(noughts):
            # The integer -0 has no sign.
            length = self._ends[noughts, source] - self._starts[noughts, source]
            column[noughts[length == len("-0")]] = 0.0
        return column

    def stamps(self, source: Source, ns_per_unit: float) -> NDArray[np.int64]:
        """Time stamps [n] in nanoseconds; `NO_TIME` where there is none."""
        if isinstance(source, tuple):
            return self._time(source)
        if isinstance(source, Missing):
            return np.full(len(self.rows), NO_TIME, dtype=np.int64)
        number = self._number[:, source]
        try:
            stamps, sure = json_stamps.of_ints(self._parse(slice(source, source + 1), pa.int64())[:, 0], ns_per_unit)
        except pa.ArrowException:
            stamps, sure = json_stamps.of_floats(self._floats[source], ns_per_unit)
        self.sure &= sure | ~number
        return np.where(number, stamps, NO_TIME)

    def _time(self, parts: tuple[int, int]) -> NDArray[np.int64]:
        if parts not in self._times:
            seconds, nanoseconds = (self._parse(slice(part, part + 1), pa.int64())[:, 0] for part in parts)
            self._times[parts], sure = json_stamps.of_parts(seconds, nanoseconds)
            # A truth value is an integer to Python.
            self.sure &= sure & self._number[:, parts[0]] & self._number[:, parts[1]]
        return self._times[parts]

    def _parse(self, columns: slice, kind: pa.DataType) -> NDArray[Any]:
        """Numbers [n, columns]; those that are literals mean nothing.

        Arrow reads strings that follow each other in a buffer. Here every second one is what lies between two
        scalars, and null.
        """
        starts, ends, number = self._starts[:, columns], self._ends[:, columns], self._number[:, columns]
        if starts.size == 0:
            return np.empty(starts.shape, dtype=kind.to_pandas_dtype())
        places = np.empty(2 * starts.size + 1, dtype=np.int32)
        places[:-1:2], places[1::2] = starts.ravel(), ends.ravel()
        places[-1] = places[-2]
        if number.all():
            valid = np.full((starts.size + 3) // 4, 0b01010101, dtype=np.uint8)
        else:
            both = np.zeros((starts.size, 2), dtype=np.bool_)
            both[:, 0] = number.ravel()
            valid = np.packbits(both.ravel(), bitorder="little")
        buffers = [pa.py_buffer(valid), pa.py_buffer(places), pa.py_buffer(self._text)]
        strings = pa.Array.from_buffers(pa.string(), 2 * starts.size, buffers)
        found = pc.cast(strings, kind).buffers()[1]
        numbers = np.frombuffer(found, dtype=kind.to_pandas_dtype(), count=2 * starts.size)
        return numbers[::2].reshape(starts.shape)


def _grammar(text: NDArray[np.uint8], starts: Positions, ends: Positions) -> tuple[Flags, Flags]:
    """Which scalars are numbers, and which are those or literals; all of the shape of `starts`.

    Of a number only that is checked which the parser lets pass and JSON does not: it begins with a digit after its
    sign, with no nought before other digits, has digits after the point and a digit at its end.
    """
    if starts.size == 0:
        return np.ones(starts.shape, dtype=np.bool_), np.ones(starts.shape, dtype=np.bool_)
    head = np.ndarray((len(text) - 3,), "<u4", text, strides=(1,))[starts]
    body = np.where((head & 0xFF) == _MINUS, head >> 8, head)
    first, second = body.astype(np.uint8), (body >> 8).astype(np.uint8)
    # Below "0", the difference wraps around.
    number: Flags = (first - _NOUGHT <= 9) & ((first != _NOUGHT) | (second - _NOUGHT > 9))
    number &= text[ends - 1] - _NOUGHT <= 9
    number &= ends - starts <= _LONGEST_NUMBER
    bare_points = np.flatnonzero((text[:-1] == _DOT) & (text[1:] | _LOWER == _E))
    if len(bare_points):
        token = np.searchsorted(starts.ravel(), bare_points, "right") - 1
        token = token[(token >= 0) & (bare_points < ends.ravel()[token])]
        number.ravel()[token] = False
    if number.all():
        return number, number
    allowed = number.copy()
    row, column = np.nonzero(~number)
    for literal in _LITERALS:
        there = ends[row, column] - starts[row, column] == len(literal)
        for at, byte in enumerate(literal):
            there &= text[starts[row, column] + at] == byte
        allowed[row[there], column[there]] = True
    return number, allowed
