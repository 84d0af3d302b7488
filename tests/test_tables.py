import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from maglev_offline.tables import write_parquet

TABLE = pd.DataFrame(
    {
        "t": pd.to_datetime([0, 1], unit="ns", utc=True),
        "gap_m": [0.008, np.nan],
        "contact": [True, False],
        "log_id": ["a", "b"],
        "seed": np.array([1, 2], dtype=np.int64),
    },
    index=[7, 3],
)


def test_a_table_comes_back_as_it_was_without_its_index(tmp_path):
    write_parquet(TABLE, tmp_path / "a.parquet")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "a.parquet"), TABLE.reset_index(drop=True))


@pytest.mark.parametrize("table", [TABLE, pa.table({"seed": [1, 2]})], ids=["pandas", "arrow"])
def test_the_same_table_gives_the_same_bytes(tmp_path, table):
    for name in "ab":
        write_parquet(table, tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_file_names_no_version_of_pandas_and_is_packed(tmp_path):
    write_parquet(TABLE, tmp_path / "a.parquet")
    found = pq.read_metadata(tmp_path / "a.parquet")
    assert b"pandas" not in (found.metadata or {})
    assert found.row_group(0).column(0).compression == "ZSTD"
