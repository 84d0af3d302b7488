import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.curate.balance.quota import balanced_choice
from maglev_offline.curate.measures.occupancy import occupancy

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
