import numpy as np
import pytest
from scipy.stats import qmc

from maglev_offline.curate.measures.discrepancy import MOST_ROWS, centred_discrepancy, discrepancies


def test_the_square_of_hickernells_centred_discrepancy_of_points_reckoned_by_hand():
    assert centred_discrepancy(np.array([[0.5]])) == pytest.approx(1 / 12)
    assert centred_discrepancy(np.array([[0.25], [0.75]])) == pytest.approx(1 / 48)


def test_even_points_have_less_of_it_than_random_ones_and_these_less_than_a_heap():
    rng = np.random.default_rng(0)
    even, random, heap = qmc.Sobol(4, seed=0).random(512), rng.random((512, 4)), 0.5 + rng.normal(0, 0.01, (512, 4))
    assert centred_discrepancy(even) < centred_discrepancy(random) < centred_discrepancy(heap)


def test_before_and_after_are_of_equally_many_rows_in_the_same_box():
    rng = np.random.default_rng(0)
    values = np.where(rng.random((5000, 1)) < 0.9, rng.normal(0, 0.01, (5000, 4)), rng.uniform(-1, 1, (5000, 4)))
    far = np.flatnonzero(np.abs(values[:, 0]) > 0.1)
    found = discrepancies(values, far, 0.005, seed=0)
    assert found.rows == min(len(far), MOST_ROWS)
    assert found.after < found.before


def test_a_choice_of_all_rows_changes_nothing_and_the_units_do_not_matter():
    values = np.random.default_rng(0).normal(size=(3000, 2))
    found = discrepancies(values, np.arange(3000), 0.005, seed=0)
    assert found.before == found.after
    assert found.rows == MOST_ROWS
    assert discrepancies(values * 1e3, np.arange(3000), 0.005, seed=0).before == pytest.approx(found.before)
