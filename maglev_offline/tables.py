"""Tables to Parquet, the same bytes for the same table."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

if TYPE_CHECKING:  # pandas takes half a second to import, and a run that finds all unchanged needs none
    import pandas as pd

ROW_GROUP = 2**18
"""Rows of a row group of a long table."""


AT_ONCE = 2**20
"""Rows of a row group of a table that is written whole (pyarrow's default), and so many are made Arrow at once."""


def write_parquet(table: pa.Table | pd.DataFrame, path: Path, as_text: Collection[str] = ()) -> None:
    """Write a table with zstd compression and without pandas' own metadata, which names its version.

    `as_text`: columns of categories that are written as text; of a long table only a part is text at a time.
    """
    if isinstance(table, pa.Table):
        pq.write_table(table, path, compression="zstd")
        return
    text = {name: "str" for name in as_text if name in table}
    writer: pq.ParquetWriter | None = None
    for begin in range(0, max(len(table), 1), AT_ONCE):
        part = table.iloc[begin : begin + AT_ONCE].astype(text)
        rows = pa.Table.from_pandas(part, preserve_index=False).replace_schema_metadata()
        writer = writer or pq.ParquetWriter(path, rows.schema, compression="zstd")
        writer.write_table(rows, row_group_size=AT_ONCE)
    if writer is not None:
        writer.close()


class ParquetSink:
    """A Parquet file that is written table by table in row groups of `ROW_GROUP`, however the tables are cut.

    `options` are those of `pyarrow.parquet.ParquetWriter`.
    """

    def __init__(self, path: Path, schema: pa.Schema, options: Mapping[str, Any] | None = None) -> None:
        self._writer = pq.ParquetWriter(path, schema, **{"compression": "zstd", **(options or {})})
        self._waiting: list[pa.Table] = []
        self._rows = 0

    def write(self, table: pa.Table) -> None:
        """Append the rows of a table."""
        self._waiting.append(table)
        self._rows += len(table)
        while self._rows >= ROW_GROUP:
            joined = pa.concat_tables(self._waiting)
            self._writer.write_table(joined.slice(0, ROW_GROUP), row_group_size=ROW_GROUP)
            self._waiting = [joined.slice(ROW_GROUP)]
            self._rows -= ROW_GROUP

    def __enter__(self) -> ParquetSink:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self._rows:
            self._writer.write_table(pa.concat_tables(self._waiting), row_group_size=ROW_GROUP)
        self._writer.close()
