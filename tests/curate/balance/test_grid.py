import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.curate.balance.grid import cells_of, narrow, quantile_cells, rows_in_cell, unit


def test_cells_cut_each_dimension_into_equal_intervals():
    values = np.array([[0.0, 0.0], [0.49, 0.0], [0.51, 0.0], [1.0, 3.0]])
    assert cells_of(values, (2, 3), 0.0).tolist() == [0, 0, 3, 5]


def test_outliers_fall_into_the_cells_at_the_edge():
    values = np.concatenate([np.linspace(0, 1, 1000), [1e300, -1e300]])[:, None]
    cell = cells_of(values, (10,), 0.01)
    assert (cell[-2:] == [9, 0]).all()
    assert np.bincount(cell).min() > 80


@pytest.mark.parametrize("spread", [0.0, 5e-324])
def test_a_dimension_that_stands_still_is_one_cell(spread):
    values = np.stack([np.linspace(0, 1, 50), np.where(np.arange(50) % 2, 0.3, 0.3 + spread)], axis=1)
    assert len(np.unique(cells_of(values, (5, 10), 0.005))) == 5


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50), st.integers(1, 20), st.floats(0, 0.49))
def test_every_row_has_a_cell_of_the_grid_and_order_is_kept(values, bins, edge):
    cell = cells_of(np.array(values)[:, None], (bins,), edge)
    assert ((cell >= 0) & (cell < bins)).all()
    assert (np.diff(cell[np.argsort(values, kind="stable")]) >= 0).all()


@settings(max_examples=30)
@given(st.lists(st.integers(0, 40), min_size=1, max_size=60), st.integers(1, 9))
def test_quantile_cells_keep_order_and_never_part_equal_values(values, bins):
    cell = quantile_cells(np.array(values, dtype=float)[:, None], (bins,))
    assert ((cell >= 0) & (cell < bins)).all()
    assert (np.diff(cell[np.argsort(values, kind="stable")]) >= 0).all()
    assert all(len(set(cell[np.array(values) == value])) == 1 for value in set(values))


def test_quantile_cells_have_equally_many_rows_along_an_axis():
    values = np.random.default_rng(0).standard_cauchy((1000, 2))
    cell = quantile_cells(values, (5, 4))
    assert np.bincount(cell // 4).tolist() == [200] * 5
    assert np.bincount(cell % 4).tolist() == [250] * 4


def test_an_axis_that_stands_still_is_one_quantile_cell():
    values = np.stack([np.arange(60.0), np.full(60, 0.3)], axis=1)
    assert len(np.unique(quantile_cells(values, (6, 10)))) == 6


def test_places_in_the_unit_box_are_by_range_and_outliers_are_at_its_edge():
    place = unit(np.append(np.linspace(-1, 3, 101), 1e9), 0.0)
    assert (place[0], place[-1]) == (0, 1)
    assert unit(np.linspace(-1, 3, 101), 0.25).tolist()[::25] == [0, 0, 0.5, 1, 1]


def test_cells_are_the_same_numbers_in_a_smaller_type():
    for largest, kind in ((200, np.uint8), (60_000, np.uint16), (10**12, np.uint64)):
        cell = np.array([3, largest])
        assert narrow(cell).dtype == kind
        assert narrow(cell).tolist() == cell.tolist()


def test_every_row_knows_how_many_share_its_cell():
    assert rows_in_cell(np.array([5, 9, 5, 5, 0])).tolist() == [3, 1, 3, 3, 1]
