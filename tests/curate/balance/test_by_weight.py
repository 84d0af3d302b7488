import numpy as np
import pytest

from maglev_offline.curate.balance import choose
from maglev_offline.curate.settings import CurateSettings


@pytest.fixture(scope="module")
def rows(log_rows):
    return log_rows(20_000)


def chosen(rows, name, target=1000, **changes):
    return choose(rows, CurateSettings(balance=name, target_rows=target, **changes))


def test_without_balance_rows_lie_as_the_log_does(rows):
    costs = rows.cost[chosen(rows, "none", 5000)]
    for level in (0.25, 0.5, 0.75):
        assert (costs <= np.quantile(rows.cost, level)).mean() == pytest.approx(level, abs=0.02)


def test_inverse_density_takes_more_of_where_rows_are_few(rows):
    far = np.abs(rows.values[:, 0]) > 1e-3
    assert far[chosen(rows, "inverse_density")].mean() > 5 * far.mean()


def test_inverse_density_makes_a_dense_and_a_thin_half_equal():
    """A row in 20 lies in the right half, each half is evenly filled: a draw takes from both alike."""
    from maglev_offline.curate.balance.candidates import Candidates

    rng = np.random.default_rng(0)
    values = np.zeros((40_000, 4))
    right = rng.random(40_000) < 0.05
    values[:, 0] = rng.random(40_000) + right
    rows = Candidates(values, np.zeros(40_000), np.zeros(40_000, dtype=np.int64))
    assert right[chosen(rows, "inverse_density", edge_quantile=0)].mean() == pytest.approx(0.5, abs=0.05)


def test_low_cost_keeps_more_of_the_cheap_rows_than_cells_and_than_no_balance(rows):
    cheap = rows.cost <= np.quantile(rows.cost, 0.25)
    kept = {name: cheap[chosen(rows, name)].sum() for name in ("low_cost", "none", "cells")}
    assert kept["low_cost"] > kept["none"] > kept["cells"]


def test_within_a_cell_a_row_without_cost_is_twice_as_likely_as_one_of_the_low_cost():
    from maglev_offline.curate.balance.candidates import Candidates

    cost = np.tile([0.0, 1.0, 3.0, 1.0], 10_000)  # the quantile 0.5 is 1
    rows = Candidates(np.zeros((40_000, 4)), cost, np.zeros(40_000, dtype=np.int64))
    taken = cost[chosen(rows, "low_cost", 2000, low_cost_quantile=0.5)]
    share = np.array([(taken == c).sum() for c in (0, 1, 3)]) / len(taken)
    np.testing.assert_allclose(share, np.array([4, 4, 1]) / 9, atol=0.04)
