"""Samples of the workspace, or a draw of them where there are more than memory should hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from maglev_offline.ingest.samples import SAMPLES, as_frame, reading
from maglev_offline.streams import stream

if TYPE_CHECKING:
    import pandas as pd

PIECE = 600
"""Samples of a piece, a minute at 100 ms: long against what a loop remembers, and many to a log."""


class Drawn(NamedTuple):
    """`samples`: a table as `load_samples` gives it; `there`: how many rows the workspace has.

    Where not all were drawn, the steps of a segment have gaps, and only samples with consecutive steps are neighbours.
    """

    samples: pd.DataFrame
    there: int

    @property
    def left(self) -> int:
        """Rows that were not drawn."""
        return self.there - len(self.samples)


def drawn_samples(folders: Sequence[Path], most: int, seed: int) -> Drawn:
    """All samples of these artefacts, or pieces of `PIECE` of one point and segment, at most `most` rows in all.

    Every piece has the same chance, whatever its log: the draw looks like the whole. The pieces depend on the samples,
    on `most` and on the seed. Memory is that of the rows drawn and of one row group.

    Raises
    ------
    ArtefactError: a folder holds no samples that can be read.
    """
    rows = [_rows(folder) for folder in folders]
    if sum(rows) <= most:
        return Drawn(as_frame([_whole(folder) for folder in folders]), sum(rows))
    starts = [_piece_starts(folder) for folder in folders]
    lengths = np.concatenate([np.diff(one, append=count) for one, count in zip(starts, rows, strict=True)])
    order = stream(seed, "samples: pieces drawn").permutation(len(lengths))
    chosen = np.zeros(len(lengths), dtype=bool)
    chosen[order[np.cumsum(lengths[order]) <= most]] = True
    ends = np.cumsum([len(one) for one in starts])[:-1]
    tables: list[pa.Table] = []
    for folder, mine, length in zip(folders, np.split(chosen, ends), np.split(lengths, ends), strict=True):
        tables += _taken(folder, np.repeat(mine, length))
    return Drawn(as_frame(tables), sum(rows))


def _rows(folder: Path) -> int:
    with reading(folder):
        return int(pq.read_metadata(folder / SAMPLES).num_rows)


def _whole(folder: Path) -> pa.Table:
    with reading(folder):
        return pq.read_table(folder / SAMPLES)


def _piece_starts(folder: Path) -> NDArray[np.int64]:
    """The rows of the file at which a piece starts: another point, another segment, or `PIECE` steps on."""
    found: list[NDArray[np.int64]] = []
    first, before = 0, None
    for group in _groups(folder, ["point", "segment", "step"]):
        coded = group["point"].cast(pa.string()).combine_chunks().dictionary_encode()
        point, names = coded.indices.to_numpy(), coded.dictionary.to_pylist()
        segment, step = group["segment"].to_numpy(), group["step"].to_numpy() // PIECE
        new = (np.diff(point) != 0) | (np.diff(segment) != 0) | (np.diff(step) != 0)
        head = (names[point[0]], int(segment[0]), int(step[0]))
        found.append(first + np.flatnonzero(np.concatenate([[head != before], new])))
        before = (names[point[-1]], int(segment[-1]), int(step[-1]))
        first += len(group)
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)


def _taken(folder: Path, wanted: NDArray[np.bool_]) -> Iterator[pa.Table]:
    """The wanted rows, row group by row group."""
    first = 0
    for group in _groups(folder):
        mine = wanted[first : first + len(group)]
        first += len(group)
        if mine.any():
            yield group.filter(pa.array(mine))


def _groups(folder: Path, columns: list[str] | None = None) -> Iterator[pa.Table]:
    with reading(folder), pq.ParquetFile(folder / SAMPLES) as file:
        for number in range(file.num_row_groups):
            group = file.read_row_group(number, columns=columns)
            if len(group):
                yield group
