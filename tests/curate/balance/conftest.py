"""Rows as a log has them."""

import numpy as np
import pytest

from maglev_offline.curate.balance import Candidates
from maglev_offline.curate.balance.grid import bins_of, cells_of
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.mdp import Mdp, row_cost


@pytest.fixture(scope="session")
def log_rows():
    """Build n rows: nine in ten stand near the set-point, the others are all over the place."""

    def build(n, seed=0):
        rng = np.random.default_rng(seed)
        spread = np.array([2e-3, 0.05, 3.0, 40.0]) * np.where(rng.random(n) < 0.9, 0.05, 1.0)[:, None]
        values = rng.standard_normal((n, 4)) * spread
        cell = cells_of(values, bins_of(CurateSettings()), CurateSettings().edge_quantile)
        return Candidates(values, row_cost(Mdp(), values[:, :3], values[:, 3]), cell)

    return build
