"""The samples table: its columns and how they are written and read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from maglev_offline.errors import ArtefactError
from maglev_offline.ingest.resample import ORIGINS
from maglev_offline.tables import ParquetSink

if TYPE_CHECKING:
    import pandas as pd

    from maglev_offline.ingest.points import PointSamples

_ORIGIN = pa.dictionary(pa.int8(), pa.string())
_NAME = pa.dictionary(pa.int32(), pa.string())
_TIME = pa.timestamp("ns", tz="UTC")

_ORIGIN_COLUMNS = {
    "gap_origin": "gap_m",
    "gap_velocity_origin": "gap_velocity_m_s",
    "current_origin": "current_a",
    "voltage_origin": "voltage_v",
}

SAMPLES = "samples.parquet"
QUARANTINE = "quarantine.parquet"


@cache
def schema(context: tuple[str, ...]) -> pa.Schema:
    """The columns of the samples table with these context columns."""
    return pa.schema(
        [
            ("log_id", _NAME),
            ("point", _NAME),
            ("t", _TIME),
            ("segment", pa.int32()),
            ("step", pa.int32()),
            ("gap_m", pa.float64()),
            ("gap_velocity_m_s", pa.float64()),
            ("current_a", pa.float64()),
            ("voltage_v", pa.float64()),
            ("set_point_m", pa.float64()),
            *((name, pa.float64()) for name in context),
            *((name, _ORIGIN) for name in _ORIGIN_COLUMNS),
            ("contact", pa.bool_()),
        ]
    )


def table(
    log_id: str, point: PointSamples, points: tuple[str, ...], context: tuple[str, ...], first_segment: int = 0
) -> pa.Table:
    """The samples of one point, its segments numbered from `first_segment`; `points` are all those of the log."""
    made = schema(context)
    n = len(point.t_ns)
    # The writer takes one dictionary for all rows as it is; strings, or another dictionary each time, it would hash.
    which = np.full(n, points.index(point.point), dtype=np.int32)
    columns: dict[str, pa.Array] = {
        "log_id": _coded(np.zeros(n, dtype=np.int32), (log_id,)),
        "point": _coded(which, points),
        "t": pa.array(point.t_ns.view("datetime64[ns]")).view(_TIME),
        "segment": pa.array(point.segment + np.int32(first_segment) if first_segment else point.segment),
        "step": pa.array(point.step),
        "contact": pa.array(point.contact),
    }
    for name in made.names:
        if name in _ORIGIN_COLUMNS:
            columns[name] = _coded(point.origins[_ORIGIN_COLUMNS[name]], ORIGINS)
        elif name not in columns:
            columns[name] = pa.array(point.values[name], type=pa.float64())
    return pa.Table.from_arrays([columns[name] for name in made.names], schema=made)


def _coded(codes: NDArray[Any], names: tuple[str, ...]) -> pa.DictionaryArray:
    # Not looked through again for codes that are beyond the names.
    return pa.DictionaryArray.from_arrays(pa.array(codes), _names(names), safe=False)


@cache
def _names(names: tuple[str, ...]) -> pa.Array:
    return pa.array(names, type=pa.string())


def open_samples(path: Path, context: tuple[str, ...]) -> ParquetSink:
    """Open a samples file for writing: numbers that count up as differences, names from a dictionary.

    lz4 takes two thirds of the time of zstd, for files that are an eighth larger.
    """
    made = schema(context)
    counting = ("t", "segment", "step")
    return ParquetSink(
        path,
        made,
        {
            "compression": "lz4",
            "write_statistics": ["log_id", "point", "t", "segment"],
            "use_dictionary": ["log_id", "point", "set_point_m", *_ORIGIN_COLUMNS],
            "data_page_size": 4 * 2**20,
            "column_encoding": dict.fromkeys(counting, "DELTA_BINARY_PACKED"),
        },
    )


def load_samples(folders: Iterable[Path], point: str | None = None) -> pd.DataFrame:
    """Read the samples of several logs into one table, in the order given; a context column that a log lacks is NaN.

    The origin columns are categories, always the same ones. `point`: of this suspension point only.

    Raises
    ------
    ArtefactError: a folder holds no samples that can be read.
    """
    tables = []
    for folder in folders:
        with reading(folder):
            tables.append(pq.read_table(folder / SAMPLES, filters=None if point is None else [("point", "==", point)]))
    return as_frame(tables)


@contextmanager
def reading(folder: Path) -> Iterator[None]:
    """Say which samples cannot be read.

    Raises
    ------
    ArtefactError: reading failed.
    """
    try:
        yield
    except (OSError, pa.ArrowException) as error:
        raise ArtefactError(
            f"the samples cannot be read ({error}).", where=str(folder), todo="Run the ingest stage again."
        ) from None


def as_frame(tables: Iterable[pa.Table]) -> pd.DataFrame:
    """One table of samples out of several, as `load_samples` gives it."""
    import pandas as pd

    tables = [_plain_names(table) for table in tables]
    context = dict.fromkeys(name for t in tables for name in t.column_names if name not in schema(()).names)
    wanted = _plain_names(schema(tuple(context)).empty_table()).schema
    joined = pa.concat_tables(tables, promote_options="default") if tables else wanted.empty_table()
    frame: pd.DataFrame = joined.select(wanted.names).to_pandas()
    for name in _ORIGIN_COLUMNS:
        frame[name] = pd.Categorical(frame[name], categories=list(ORIGINS))
    return frame


def _plain_names(table: pa.Table) -> pa.Table:
    """Names as strings: every log has its own dictionary of them."""
    for name in ("log_id", "point"):
        at = table.schema.get_field_index(name)
        table = table.set_column(at, name, table[name].cast(pa.string()))
    return table
