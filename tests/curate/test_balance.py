import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.curate.balance import (
    balanced_choice,
    cells_of,
    effective_sample_size,
    importance_weights,
    occupancy,
)

cells = st.lists(st.integers(0, 12), min_size=1, max_size=200).map(lambda x: np.array(x, dtype=np.int64))
seeds = st.integers(0, 100)


def quota_by_hand(cell, target):
    """Raise the quota by one until it would take too many rows."""
    counts = np.bincount(cell)
    quota = 0
    while sum(min(int(c), quota + 1) for c in counts) <= target and quota < counts.max():
        quota += 1
    return quota


@given(cells, st.integers(1, 250), seeds)
def test_a_choice_has_the_target_number_of_different_rows_or_all_of_them(cell, target, seed):
    chosen = balanced_choice(cell, target, np.random.default_rng(seed))
    assert len(chosen) == min(target, len(cell))
    assert (np.diff(chosen) > 0).all()
    assert chosen[0] >= 0
    assert chosen[-1] < len(cell)


@given(cells, st.integers(1, 250), seeds)
def test_every_cell_gives_its_quota_and_at_most_one_row_more(cell, target, seed):
    chosen = balanced_choice(cell, target, np.random.default_rng(seed))
    quota = quota_by_hand(cell, target)
    given_by = np.bincount(cell[chosen], minlength=13)
    counts = np.bincount(cell, minlength=13)
    assert (given_by >= np.minimum(counts, quota)).all()
    assert (given_by <= np.minimum(counts, quota + 1)).all()


@given(cells, st.integers(1, 250), seeds)
def test_the_same_seed_chooses_the_same_rows(cell, target, seed):
    first, second = (balanced_choice(cell, target, np.random.default_rng(seed)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_another_seed_chooses_other_rows_of_a_cell():
    cell = np.zeros(1000, dtype=np.int64)
    first, second = (balanced_choice(cell, 100, np.random.default_rng(seed)) for seed in (0, 1))
    assert not np.array_equal(first, second)


def test_rows_of_a_cell_are_equally_likely():
    cell = np.array([0] * 10 + [1] * 2)
    times = sum(np.isin(np.arange(12), balanced_choice(cell, 6, np.random.default_rng(seed))) for seed in range(2000))
    np.testing.assert_allclose(times[:10] / 2000, 0.4, atol=0.05)
    np.testing.assert_array_equal(times[10:], 2000)


def test_the_remainder_does_not_favour_a_cell():
    cell = np.repeat([0, 1, 2], 10)
    extra = np.zeros(3)
    for seed in range(1500):
        extra += np.bincount(cell[balanced_choice(cell, 7, np.random.default_rng(seed))], minlength=3) - 2
    np.testing.assert_allclose(extra / 1500, 1 / 3, atol=0.05)


@given(cells, st.integers(1, 250), seeds)
def test_balance_never_lowers_evenness(cell, target, seed):
    if target < len(np.unique(cell)):
        target = len(np.unique(cell))
    before = occupancy(cell)
    after = occupancy(cell[balanced_choice(cell, target, np.random.default_rng(seed))])
    assert after.occupied_cells == before.occupied_cells
    # A remainder of one row for some cells may make the shares of equally filled cells differ by one row.
    if target % before.occupied_cells == 0 or quota_by_hand(cell, target) >= 20:
        assert after.entropy >= before.entropy - 1e-2
        assert after.effective_cells >= before.effective_cells * 0.99


def test_balance_evens_out_a_log_that_stands_at_its_set_point():
    cell = np.repeat(np.arange(10), [9910, *[10] * 9])
    before, after = occupancy(cell), occupancy(cell[balanced_choice(cell, 100, np.random.default_rng(0))])
    assert before.effective_cells < 1.1
    assert after.effective_cells == pytest.approx(10)
    assert after.entropy == pytest.approx(np.log(10))


def test_occupancy_of_cells_counted_by_hand():
    found = occupancy(np.array([4, 4, 9, 4]))
    assert found.rows == 4
    assert found.occupied_cells == 2
    assert found.entropy == pytest.approx(-(0.75 * np.log(0.75) + 0.25 * np.log(0.25)))
    assert found.effective_cells == pytest.approx(1 / (0.75**2 + 0.25**2))
    assert occupancy(np.array([], dtype=np.int64)) == (0, 0, 0.0, 0.0)


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
