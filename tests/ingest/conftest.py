from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest

from maglev_offline.ingest.log import ingest_log
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.physics.parameters import Plant
from maglev_offline.workspace import Workspace

T0 = 1_700_000_000_000_000_000
"""A multiple of every grid period used here, in ns."""


@pytest.fixture(scope="session")
def plant():
    """The paper's suspension: stops at 0.5 and 16 mm."""
    return Plant()


@pytest.fixture(scope="session")
def grid_10():
    """A grid of 10 ms; holes above 25 ms."""
    return IngestSettings(grid_ms=10, longest_bridge_ms=25, reorder_ms=50)


@pytest.fixture
def workspace(tmp_path):
    """An empty workspace."""
    return Workspace(tmp_path / "workspace")


@pytest.fixture(scope="session")
def write_log(mcap_files):
    """Write a log of one topic from messages in file order: times in ms after T0, gaps in mm, or whole values."""

    def write(path, t_ms, gap_mm=None, *, values=None, topic="/suspension/F1/state", extra=(), **options):
        if values is None:
            gap_mm = np.full(len(t_ms), 8.0) if gap_mm is None else gap_mm
            values = [
                {"gap_mm": float(g), "coil_current_a": 20.0 + k, "coil_voltage_v": 24.0 - k}
                for k, g in enumerate(gap_mm)
            ]
        times = [T0 + round(t * 1e6) for t in t_ms]
        messages = [mcap_files.Msg(topic, t, v) for t, v in zip(times, values, strict=True)]
        return mcap_files.write(path, [*messages, *extra], **options)

    return write


@pytest.fixture(scope="session")
def ingest_path(tmp_path_factory):
    """Ingest logs by their path; gives the two tables beside what `ingest_log` gives."""

    def run(path, *, signals=None, settings=None, plant=None, log_id="a", jobs=1, **tables):
        request = Request(signals, settings or IngestSettings(), plant or Plant(), **tables)
        out = tmp_path_factory.mktemp("ingested")
        made = ingest_log(path, log_id, request, out, jobs=jobs)
        written = {name: pq.read_table(out / f"{name}.parquet") for name in ("samples", "quarantine")}
        return SimpleNamespace(**vars(made), **written, folder=out)

    return run
