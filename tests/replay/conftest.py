"""A workspace with curated transitions that were made without any log."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.workspace import Manifest, Workspace


@pytest.fixture(scope="session")
def transitions():
    """A hundred curated transitions; some end in contact, some at the end of a segment."""
    rng = np.random.default_rng(5)
    n = 100
    table = pd.DataFrame(
        rng.normal(0, [0.002, 0.05, 2.0], (n, 3)), columns=["gap_error_m", "gap_velocity_m_s", "current_error_a"]
    )
    table["voltage_deviation_v"] = rng.uniform(-200, 200, n)
    table["cost"] = rng.uniform(0, 1, n)
    for name in ("gap_error_m", "gap_velocity_m_s", "current_error_a"):
        table[f"next_{name}"] = table[name] + rng.normal(0, 1e-3, n)
    table["terminated"] = np.arange(n) % 25 == 24
    table["truncated"] = np.arange(n) % 10 == 9
    table["discount"] = Mdp().discount * ~table["terminated"]
    table["split"] = "train"
    return table


@pytest.fixture
def put_transitions(tmp_path):
    """Commit curated transitions, and return their workspace."""

    def put(table, plant=None, mdp=None, construction="raw"):
        workspace = Workspace(tmp_path / "workspace")
        manifest = Manifest("transitions", "by hand", {})
        manifest.settings = {
            "plant": (plant or Plant()).model_dump(mode="json"),
            "mdp": (mdp or Mdp()).model_dump(mode="json"),
        }
        manifest.counts, manifest.facts = {"transitions": len(table)}, {"construction": construction}
        with workspace.commit(workspace.path("transitions"), manifest) as draft:
            table.to_parquet(draft / "transitions.parquet")
        return workspace

    return put
