import numpy as np
import pytest

from maglev_offline.curate.measures.occupancy import occupancy


def test_occupancy_of_cells_counted_by_hand():
    found = occupancy(np.array([4, 4, 9, 4]))
    assert found.rows == 4
    assert found.occupied_cells == 2
    assert found.entropy == pytest.approx(-(0.75 * np.log(0.75) + 0.25 * np.log(0.25)))
    assert found.effective_cells == pytest.approx(1 / (0.75**2 + 0.25**2))
    assert occupancy(np.array([], dtype=np.int64)) == (0, 0, 0.0, 0.0)
