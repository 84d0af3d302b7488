"""Tables to Parquet, the same bytes for the same table."""

from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq


def write_parquet(table: pa.Table | pd.DataFrame, path: Path) -> None:
    """Write a table with zstd compression and without pandas' own metadata, which names its version."""
    if isinstance(table, pd.DataFrame):
        table = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata()
    pq.write_table(table, path, compression="zstd")
