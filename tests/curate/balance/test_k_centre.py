import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from maglev_offline.curate.balance import choose, k_centre
from maglev_offline.curate.balance.k_centre import farthest_first, thinned, unit_points
from maglev_offline.curate.settings import CurateSettings


def radius(points, chosen):
    """Largest distance of a point [d, n] from the nearest chosen one."""
    return float(cKDTree(points[:, chosen].T).query(points.T)[0].max())


@given(st.integers(0, 200), st.integers(1, 6))
@settings(max_examples=25)
def test_greedy_is_within_twice_the_best_radius_of_points_on_a_line(seed, count):
    """On a line the best radius is known: half the least length of which `count` intervals hold all points."""
    x = np.sort(np.random.default_rng(seed).random(12)).astype(np.float32)
    chosen = farthest_first(x[None, :], count, 0)
    assert len(set(chosen.tolist())) == count
    lengths = np.unique(np.abs(x[:, None] - x[None, :]))
    best = next(length for length in lengths if intervals(x, length) <= count) / 2
    assert radius(x[None, :], chosen) <= 2 * best + 1e-6


def intervals(x, length):
    """So many intervals of this length hold all points."""
    needed, end = 0, -np.inf
    for value in x:
        if value > end + 1e-6:  # single precision
            needed, end = needed + 1, value + length
    return needed


def test_points_on_a_square_are_taken_corner_by_corner():
    points = np.array([[0, 0, 1, 1, 0.5], [0, 1, 0, 1, 0.4]], dtype=np.float32)
    assert farthest_first(points, 5, 0).tolist() == [0, 3, 1, 2, 4]


def test_equal_points_are_never_taken_twice():
    assert sorted(farthest_first(np.zeros((4, 6), dtype=np.float32), 6, 2).tolist()) == list(range(6))


@pytest.mark.parametrize("most", [1, 20, 500, 5000])
def test_thinning_leaves_a_row_of_each_cell_and_none_is_farther_than_its_diagonal(log_rows, most):
    points = unit_points(log_rows(3000).values, 0.005)
    thin = thinned(points, most, np.random.default_rng(0))
    assert len(thin.row) <= most
    np.testing.assert_array_equal(np.unique(thin.cell[thin.row]), np.unique(thin.cell))
    assert len(np.unique(thin.cell[thin.row])) == len(thin.row)
    assert radius(points, thin.row) <= np.sqrt(4) / thin.bins + 1e-6


def test_coverage_leaves_no_row_far_from_a_chosen_one(log_rows):
    rows = log_rows(4000)
    points = unit_points(rows.values, 0.005)
    reached = {
        name: radius(points, choose(rows, CurateSettings(balance=name, target_rows=200)))
        for name in ("coverage", "cells", "none")
    }
    assert reached["coverage"] < 0.7 * reached["cells"]
    assert reached["coverage"] < 0.7 * reached["none"]


def test_where_distances_would_be_too_many_the_grid_is_coarser_and_every_cell_gives_its_share(log_rows, monkeypatch):
    monkeypatch.setattr(k_centre, "MOST_DISTANCES", 4000)
    rows, points = log_rows(1000), unit_points(log_rows(1000).values, 0.005)
    chosen = choose(rows, CurateSettings(balance="coverage", target_rows=200))
    assert len(chosen) == 200
    thin = thinned(points, 20, np.random.default_rng(0))
    assert radius(points, chosen) <= 2 / thin.bins
