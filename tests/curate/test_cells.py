import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.curate.cells import CELLS, cells_along, ends, inner_edges, state_cells

VALUES = st.lists(st.floats(-10, 10), min_size=1, max_size=60).map(np.array)


@settings(max_examples=25)
@given(VALUES)
def test_every_value_lies_in_its_cell_and_cells_are_even_about_zero(values):
    edges = inner_edges(values)
    cell, (low, high) = cells_along(values, edges), ends(edges)
    assert len(low) == len(high) == CELLS
    assert ((low[cell] <= values) & (values < high[cell])).all()
    np.testing.assert_array_equal(edges, -edges[::-1])
    assert (np.diff(edges) > 0).all()


def test_zero_lies_in_the_middle_and_a_fortieth_of_the_rows_outermost():
    values = np.linspace(-1, 1, 2001)
    cell = cells_along(values, inner_edges(values))
    assert cell[values == 0] == CELLS // 2
    assert np.isin(cell, [0, CELLS - 1]).mean() == pytest.approx(0.025, abs=1e-3)
    assert cells_along(np.zeros(3), inner_edges(np.zeros(3))).tolist() == [CELLS // 2] * 3


def test_cells_of_the_state_are_numbered_as_their_places_are():
    gap, velocity = np.random.default_rng(0).normal(0, [[1e-3], [0.02]], (2, 500))
    cells = state_cells(gap, velocity)
    place = cells.places.iloc[cells.number]
    assert (place["gap_from_m"].to_numpy() <= gap).all()
    assert (gap < place["gap_to_m"].to_numpy()).all()
    assert (place["velocity_from_m_s"].to_numpy() <= velocity).all()
    assert (velocity < place["velocity_to_m_s"].to_numpy()).all()
    assert len(cells.places) == CELLS**2
