"""What a log's values are, whatever the file: a small sketch of them by which logs that share content find each other.

Each row of gap, current and voltage as logged is hashed. A shingle is `SHINGLE` rows in a row, where repeats of one row
count once, so that a signal at rest says nothing. About one shingle in 16 is kept as an anchor, chosen by its hash
alone; a short log keeps them all. Times, topics, encodings and files do not enter. The numbers do, bit by bit: a copy
in float32 or in another unit is another content.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from maglev_offline.errors import ArtefactError
from maglev_offline.tables import write_parquet

Hashes = NDArray[np.uint64]
Rows = NDArray[np.int64]

SHINGLE = 8
"""Rows in a shingle; a power of two, as a shingle is made by doubling."""
DENSE_ROWS = 4096
"""A log of at most so many rows keeps every shingle."""
CONTENT = "content.parquet"

_SPARSE_BELOW = np.uint64(1 << 60)  # of 64 bits: one in 16
_SPREAD, _MIX = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9)
_BASE = 0x2545F4914F6CDD1D  # odd, of the polynomials over the rows
_MASK = (1 << 64) - 1
_BLOCK = 32768  # rows that are hashed at once


@dataclass(frozen=True)
class ContentSketch:
    """The sketch of one point of a log.

    `anchors`: hashes of shingles, uint64 [n]; `position`: the row at which each begins, int64 [n], ascending; `t_ns`:
    the time of that row, int64 [n], or None where no times were given. `rows`: how many rows there were; `whole`: a
    hash of all rows in order.
    """

    anchors: Hashes
    position: Rows
    t_ns: Rows | None
    rows: int
    whole: int

    @property
    def dense(self) -> bool:
        """Whether every shingle is here."""
        return self.rows <= DENSE_ROWS


def is_sparse(anchors: Hashes) -> NDArray[np.bool_]:
    """Which shingles a long log keeps, shape [n]."""
    sparse: NDArray[np.bool_] = anchors < _SPARSE_BELOW
    return sparse


def fingerprint_rows(values: Mapping[str, NDArray[np.float64]], t_ns: Rows | None = None) -> ContentSketch:
    """Sketch the rows of one point in order of time; each signal has shape [n] (ValueError where they differ).

    Only logs that were sketched with signals of the same names can be compared.
    """
    hasher = ContentHasher()
    hasher.add(values, t_ns)
    return hasher.sketch()


class ContentHasher:
    """Sketches a log window by window: any cut into windows gives the same sketch."""

    def __init__(self) -> None:
        self._rows, self._whole, self._timed = 0, 0, True
        self._carried = _Piece(np.empty(0, np.uint64), np.empty(0, np.int64), np.empty(0, np.int64))
        self._kept: list[_Piece] = []

    def add(self, values: Mapping[str, NDArray[np.float64]], t_ns: Rows | None = None) -> None:
        """Take the next rows, with their times if the places are to be told in times; all windows or none have them."""
        hashed = row_hashes(values)
        first, count = self._rows, len(hashed)
        if t_ns is None:
            self._timed = self._timed and count == 0
        elif len(t_ns) != count:
            raise ValueError(f"{len(t_ns)} times for {count} rows")
        self._rows += count
        self._whole = (self._whole + _fold(hashed) * pow(_BASE, first, 1 << 64)) & _MASK

        rows = self._after_carried(hashed, t_ns)
        changes = _differs_from_last(rows.hash)
        if not changes.all():
            rows = rows.part(changes)
        made = len(rows.hash) - SHINGLE + 1
        self._carried = rows.part(np.arange(max(made, 0), len(rows.hash)))  # a copy: a slice would keep all rows
        if made > 0:
            shingles = _Piece(_shingles(rows.hash), rows.row[:made], rows.t_ns[:made])
            self._kept.append(shingles if self._rows <= DENSE_ROWS else _thinned(shingles))
        if first <= DENSE_ROWS < self._rows:
            self._kept = [_thinned(piece) for piece in self._kept]

    def _after_carried(self, hashed: Hashes, t_ns: Rows | None) -> "_Piece":
        at = np.arange(self._rows - len(hashed), self._rows)
        new = _Piece(hashed, at, t_ns if t_ns is not None else at)
        if len(self._carried.hash) == 0:
            return new
        return _Piece(*(np.concatenate(pair) for pair in zip(self._carried, new, strict=True)))

    def sketch(self) -> ContentSketch:
        """Return the sketch of all rows so far."""
        parts = self._kept or [self._carried.part(slice(0))]
        anchors, position, t_ns = (np.concatenate([part[k] for part in parts]) for k in range(3))
        return ContentSketch(anchors, position, t_ns if self._timed else None, self._rows, self._whole)


class _Piece(NamedTuple):
    """Hashes [n] with the row at which each begins, and its time."""

    hash: Hashes
    row: Rows
    t_ns: Rows

    def part(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> "_Piece":
        return _Piece(self.hash[rows], self.row[rows], self.t_ns[rows])


def _thinned(shingles: _Piece) -> _Piece:
    return shingles.part(np.flatnonzero(is_sparse(shingles.hash)))


def row_hashes(values: Mapping[str, NDArray[np.float64]]) -> Hashes:
    """Hash each row, shape [n]: -0 is 0, every NaN is the same, and a signal's name is part of its value."""
    names = sorted(values)
    if not names:
        raise ValueError("there is no signal to hash")
    columns = [np.asarray(values[name], dtype=np.float64) for name in names]
    if any(column.shape != (len(columns[0]),) for column in columns):
        raise ValueError("the signals are not of one length")
    hashed = np.empty(len(columns[0]), dtype=np.uint64)
    salts = [np.uint64((crc32(name.encode()) << 32 | crc32(name.encode()[::-1])) & _MASK) for name in names]
    scratch = np.empty(min(_BLOCK, len(hashed)), dtype=np.uint64)
    for start in range(0, len(hashed), _BLOCK):
        rows = hashed[start : start + _BLOCK]
        rows[:] = 0
        for salt, column in zip(salts, columns, strict=True):
            _mix_in(rows, column[start : start + _BLOCK], salt, scratch[: len(rows)])
    return hashed


def _mix_in(rows: Hashes, column: NDArray[np.float64], salt: np.uint64, scratch: Hashes) -> None:
    """Mix a signal into the rows' hashes, in place.

    A multiplication carries upward only, and round numbers have their digits above: shift down first.
    """
    plain = column + 0.0
    missing = np.isnan(plain)
    if missing.any():
        plain[missing] = np.nan
    bits = plain.view(np.uint64)
    np.right_shift(bits, np.uint64(32), out=scratch)
    bits ^= scratch
    bits *= _SPREAD
    rows ^= bits
    rows += salt
    np.right_shift(rows, np.uint64(29), out=scratch)
    rows ^= scratch
    rows *= _MIX
    np.right_shift(rows, np.uint64(32), out=scratch)
    rows ^= scratch


def _differs_from_last(hashed: Hashes) -> NDArray[np.bool_]:
    differs = np.ones(len(hashed), dtype=np.bool_)
    np.not_equal(hashed[1:], hashed[:-1], out=differs[1:])
    return differs


def _shingles(hashed: Hashes) -> Hashes:
    """Hash every `SHINGLE` rows in a row: a polynomial of their hashes, by doubling. Shape [n - SHINGLE + 1]."""
    width, made = 1, hashed
    while width < SHINGLE:
        made = made[:-width] * np.uint64(pow(_BASE, width, 1 << 64)) + made[width:]
        width *= 2
    return made


def _fold(hashed: Hashes) -> int:
    """Sum of hash times base to the power of its row, modulo 2**64."""
    total = 0
    for start in range(0, len(hashed), _BLOCK):
        rows = hashed[start : start + _BLOCK]
        total += int(np.dot(rows, _powers()[: len(rows)])) * pow(_BASE, start, 1 << 64)
    return total & _MASK


@cache
def _powers() -> Hashes:
    powers = np.full(_BLOCK, _BASE, dtype=np.uint64)
    powers[0] = 1
    return np.multiply.accumulate(powers)


_SCHEMA = pa.schema([("point", pa.string()), ("anchor", pa.uint64()), ("position", pa.int64()), ("t_ns", pa.int64())])


def save_content(sketches: Mapping[str, ContentSketch], path: Path) -> None:
    """Write the sketches of a log's points as one table; the rows and the whole hash are in its metadata."""
    tables = []
    for point, sketch in sketches.items():
        n = len(sketch.anchors)
        t_ns = pa.array(sketch.t_ns, pa.int64()) if sketch.t_ns is not None else pa.nulls(n, pa.int64())
        columns = [pa.repeat(point, n), pa.array(sketch.anchors), pa.array(sketch.position), t_ns]
        tables.append(pa.Table.from_arrays(columns, schema=_SCHEMA))
    table = pa.concat_tables(tables) if tables else _SCHEMA.empty_table()
    facts = {
        point: {"rows": sketch.rows, "whole": sketch.whole, "timed": sketch.t_ns is not None}
        for point, sketch in sketches.items()
    }
    write_parquet(table.replace_schema_metadata({"content": json.dumps(facts)}), path)


def load_content(path: Path) -> dict[str, ContentSketch]:
    """Read the sketches of a log's points.

    Raises
    ------
    ArtefactError: the file cannot be read or holds no sketches.
    """
    try:
        table = pq.read_table(path)
        facts = json.loads(table.schema.metadata[b"content"])
        table = table.cast(_SCHEMA)
        names = table["point"].to_numpy()
        anchors, position, t_ns = (table[name].to_numpy() for name in ("anchor", "position", "t_ns"))
        sketches = {}
        for point, fact in facts.items():
            mine = names == point
            times = t_ns[mine].astype(np.int64) if fact["timed"] else None
            sketches[point] = ContentSketch(anchors[mine], position[mine], times, int(fact["rows"]), int(fact["whole"]))
        return sketches
    except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise ArtefactError(
            f"the content sketch cannot be read ({error}).", where=str(path), todo="Run the ingest stage again."
        ) from None
