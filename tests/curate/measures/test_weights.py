import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.curate.balance.quota import balanced_choice
from maglev_offline.curate.measures.weights import effective_sample_size, importance_weights

cells = st.lists(st.integers(0, 12), min_size=1, max_size=200).map(lambda x: np.array(x, dtype=np.int64))
seeds = st.integers(0, 100)


@given(cells, st.integers(13, 250), seeds)
def test_weights_restore_the_share_that_every_cell_had(cell, target, seed):
    chosen = balanced_choice(cell, target, np.random.default_rng(seed))
    weight = importance_weights(cell, chosen)
    assert weight.mean() == pytest.approx(1)
    restored = np.bincount(cell[chosen], weights=weight, minlength=13) / weight.sum()
    np.testing.assert_allclose(restored, np.bincount(cell, minlength=13) / len(cell), atol=1e-12)


def test_the_effective_sample_size_is_that_of_kish():
    assert effective_sample_size(np.array([1.0, 1, 1, 1])) == pytest.approx(4)
    assert effective_sample_size(np.array([3.0, 1.0])) == pytest.approx(16 / 10)
    assert effective_sample_size(np.array([])) == 0


def test_a_cell_of_which_nothing_was_chosen_is_left_out_of_the_weights():
    cell = np.array([0, 0, 0, 1, 7])
    assert importance_weights(cell, np.array([0, 3])).tolist() == [1.5, 0.5]
