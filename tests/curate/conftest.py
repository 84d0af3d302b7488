"""Small tables of samples, written out by hand."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.workspace import Manifest


@pytest.fixture(scope="session")
def samples_of():
    """Build samples of one segment, 100 ms apart, at the set-point unless told otherwise."""

    def build(gap_m, *, log_id="log-a", point="P1", segment=0, set_point_m=0.008, current_a=20.0, voltage_v=24.0,
              velocity_m_s=0.0, contact=False):  # fmt: skip
        n = len(gap_m)
        return pd.DataFrame(
            {
                "log_id": log_id,
                "point": point,
                "t": pd.to_datetime(np.arange(n) * 100_000_000, unit="ns", utc=True),
                "segment": np.full(n, segment, dtype=np.int32),
                "step": np.arange(n, dtype=np.int32),
                "gap_m": np.asarray(gap_m, dtype=float),
                "gap_velocity_m_s": np.broadcast_to(np.asarray(velocity_m_s, dtype=float), n),
                "current_a": np.broadcast_to(np.asarray(current_a, dtype=float), n),
                "voltage_v": np.broadcast_to(np.asarray(voltage_v, dtype=float), n),
                "set_point_m": np.broadcast_to(np.asarray(set_point_m, dtype=float), n),
                **dict.fromkeys(("gap_origin", "gap_velocity_origin", "current_origin", "voltage_origin"), "measured"),
                "contact": np.broadcast_to(np.asarray(contact), n),
            }
        )

    return build


@pytest.fixture(scope="session")
def wandering(samples_of):
    """Samples that wander over states and voltages, different in every log."""

    def build(log_id, rows, seed=0):
        rng = np.random.default_rng((seed, *log_id.encode()))
        return samples_of(
            0.008 + 0.002 * rng.standard_normal(rows).clip(-3, 3),
            log_id=log_id,
            velocity_m_s=0.02 * rng.standard_normal(rows),
            current_a=20 + rng.standard_normal(rows),
            voltage_v=24 + 20 * rng.standard_normal(rows).clip(-3, 3),
        )

    return build


@pytest.fixture(scope="session")
def put_samples():
    """Commit a table of samples as the artefact of its log."""

    def put(workspace, table):
        log_id = table["log_id"].iloc[0]
        manifest = Manifest("samples", f"samples of {log_id}", {}, counts={"rows": len(table)})
        with workspace.commit(workspace.path("samples", log_id), manifest) as draft:
            table.to_parquet(draft / "samples.parquet")

    return put
