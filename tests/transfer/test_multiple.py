import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.transfer.multiple import holm, sign_flip_p


def rng():
    return np.random.default_rng(0)


def test_holms_correction_gives_the_worked_example():
    # Holm (1979): multiply the smallest by m, the next by m - 1, ..., and never fall below an earlier one.
    assert holm({"a": 0.01, "b": 0.04, "c": 0.03, "d": 0.005}) == pytest.approx(
        {"a": 0.03, "b": 0.06, "c": 0.06, "d": 0.02}
    )


@given(st.dictionaries(st.integers(), st.floats(0, 1), max_size=12))
@settings(max_examples=50)
def test_corrected_values_keep_the_order_and_never_fall(p_values):
    adjusted = holm(p_values)
    assert list(adjusted) == list(p_values)
    assert all(p_values[key] <= adjusted[key] <= 1 for key in p_values)
    order = sorted(p_values, key=p_values.get)
    assert [adjusted[key] for key in order] == sorted(adjusted.values())


def test_the_sign_flip_test_is_exact_for_few_seeds():
    # Of the 2^5 sign patterns of five equal differences, only two have a mean as far from zero.
    assert sign_flip_p(np.ones(5), rng()) == pytest.approx(2 / 32)


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=9))
@settings(max_examples=50)
def test_all_changes_of_sign_are_counted(values):
    difference = np.array(values)
    signs = np.array(list(itertools.product([-1, 1], repeat=len(values))))
    least = abs(difference.sum()) - 1e-9 * np.abs(difference).sum()
    share = np.mean(np.abs(signs @ difference) >= least)
    assert sign_flip_p(difference, rng()) == pytest.approx(share if difference.any() else 1.0)


def test_counting_and_drawing_agree():
    difference = np.random.default_rng(3).normal(0.5, 1, 30)
    drawn = np.r_[difference, 0.0]  # a difference of nothing makes it one seed too many to count
    assert sign_flip_p(difference, rng()) == pytest.approx(sign_flip_p(drawn, rng()), abs=0.01)


def test_equal_arms_one_seed_and_lost_numbers_surprise_nobody():
    assert sign_flip_p(np.zeros(8), rng()) == 1.0
    assert sign_flip_p(np.array([3.0]), rng()) == 1.0
    assert sign_flip_p(np.array([1.0, np.nan, 2.0]), rng()) == 1.0


def test_the_order_of_seeds_does_not_matter():
    difference = np.random.default_rng(1).normal(0.5, 1, 20)
    assert sign_flip_p(difference, rng()) == sign_flip_p(difference[::-1], rng())


def test_equal_arms_are_called_different_at_the_nominal_rate():
    data = np.random.default_rng(2).normal(size=(400, 8))
    alarms = np.mean([sign_flip_p(row, rng()) <= 0.05 for row in data])
    assert 0.02 <= alarms <= 0.08
