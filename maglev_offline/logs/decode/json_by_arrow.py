"""JSON messages through Arrow's parser, with a schema made from some of them."""

import json
import re
from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import pyarrow.json as pj
from numpy.typing import NDArray

from maglev_offline.logs.decode.json_block import Block, in_bounds, part, slices
from maglev_offline.logs.decode.json_doubts import doubtful
from maglev_offline.logs.decode.json_shape import NoShapeError, Read, Shape
from maglev_offline.logs.decode.payloads import Decoded, Path, Payloads, Wanted, nothing_sure

_SAMPLES = 8
"""So many messages are looked at for the shape of all."""

_LARGEST = 1 << 24
"""Bytes of the longest message that Arrow is given."""

_FEW = 16
"""A stretch of so many rows is not divided any more when Arrow refuses it."""

_ROWS_PER_TRIAL = 16
"""So often at most is a new trial made: with more broken messages than that, the library is faster."""

_IN_ROW = re.compile(r"in row (\d+)")


class ArrowJson:
    """Reads messages with Arrow's parser; those that it may not read as Python does are not sure."""

    rung = "arrow"

    def __init__(self, wanted: Wanted) -> None:
        self._wanted = wanted
        self._clock: Path | None = tuple(wanted.clock.path.split(".")) if wanted.clock else None

    def decode(self, payloads: Payloads) -> Decoded:
        """Read the wanted columns."""
        found = nothing_sure(self._wanted.paths, len(payloads), stamped=self._wanted.clock is not None)
        rows = np.flatnonzero((payloads.length > 1) & (payloads.length <= _LARGEST))
        if len(rows) == 0 or not in_bounds(payloads):
            return found
        shapes = self._shapes(payloads, rows)
        for first, last in slices(part(payloads, rows)):
            self._slice(payloads, rows[first:last], shapes, found)
        return found

    def _shapes(self, payloads: Payloads, rows: NDArray[np.intp]) -> list[Shape]:
        """The shapes to try in turn: a plain number as clock is first taken for an integer, which loses nothing."""
        samples = []
        for row in np.unique(np.linspace(0, len(rows) - 1, _SAMPLES).astype(np.intp)).tolist():
            try:
                samples.append(json.loads(payloads.of(int(rows[row]))))
            except (ValueError, RecursionError):
                continue
        paths = [*self._wanted.paths, *([self._clock] if self._clock else [])]
        shapes: list[Shape] = []
        for whole_clock in dict.fromkeys((self._clock, None)):
            try:
                shape = Shape.of(samples, paths, whole_clock)
            except NoShapeError:
                continue
            if all(shape.schema != other.schema for other in shapes):
                shapes.append(shape)
        return shapes

    def _slice(self, payloads: Payloads, rows: NDArray[np.intp], shapes: Sequence[Shape], found: Decoded) -> None:
        """Read some rows; where Arrow refuses, without the row that it names, or else in halves."""
        block = Block(part(payloads, rows), 0)
        doubts = doubtful(block)
        if doubts.any():
            rows = rows[~doubts]
            if len(rows) == 0:
                return
            block = Block(part(payloads, rows), 0)
        text = pa.py_buffer(block.text)
        stretches = [(0, len(rows))]
        trials = 4 + len(rows) // _ROWS_PER_TRIAL
        while stretches and trials > 0:
            first, last = stretches.pop()
            lines = text.slice(int(block.start[first]), int(block.end[last - 1] - block.start[first]))
            trials -= 1
            refused_row = self._read(lines, rows[first:last], shapes, found)
            if refused_row is None:
                continue
            if 0 <= refused_row < last - first:
                parts = [(first + refused_row + 1, last), (first, first + refused_row)]
            elif last - first > _FEW:
                middle = (first + last) // 2
                parts = [(middle, last), (first, middle)]
            else:
                parts = []
            stretches += [(a, b) for a, b in parts if a < b]

    def _read(self, lines: pa.Buffer, rows: NDArray[np.intp], shapes: Sequence[Shape], found: Decoded) -> int | None:
        """Read these rows and return None; where none of the shapes fits, the row that the parser names, or -1."""
        refused_row = -1
        for shape in shapes:
            try:
                table = _table(lines, shape.schema)
            except pa.ArrowException as error:
                named = _IN_ROW.search(str(error))
                refused_row = int(named.group(1)) if named else -1
                continue
            if len(table) == len(rows):
                self._fill(Read(shape, table), rows, found)
                return None
        return refused_row

    def _fill(self, read: Read, rows: NDArray[np.intp], found: Decoded) -> None:
        for column, path in zip(found.values, self._wanted.paths, strict=True):
            column[rows] = read.numbers(path)
        if found.stamp_ns is not None and self._wanted.clock is not None and self._clock is not None:
            found.stamp_ns[rows] = read.stamps(self._clock, self._wanted.clock.ns_per_unit)
        found.sure[rows] = read.sure


def _table(lines: pa.Buffer, schema: pa.Schema) -> pa.Table:
    return pj.read_json(
        pa.BufferReader(lines),
        read_options=pj.ReadOptions(use_threads=False, block_size=lines.size + 1),
        parse_options=pj.ParseOptions(explicit_schema=schema, unexpected_field_behavior="ignore"),
    )
