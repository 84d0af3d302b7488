import numpy as np
import pytest

from maglev_offline.transfer.multiple import sign_flip_p
from maglev_offline.transfer.power import MOST_SEEDS, detectable, seeds_needed


def test_twice_the_scatter_needs_four_times_the_seeds():
    difference = np.random.default_rng(0).normal(0, 1, 20)
    once, twice = (seeds_needed(scale * difference, 0.2, 0.95) for scale in (1, 2))
    assert twice == pytest.approx(4 * once, rel=0.02)


def test_so_many_seeds_show_the_effect_and_one_fewer_does_not():
    difference = np.random.default_rng(1).normal(0, 1, 12)
    n = seeds_needed(difference, 0.7, 0.95)
    spread = np.resize([1.0, -1.0], n) * difference.std(ddof=1) * np.sqrt((n - 1) / n)
    fewer = np.resize([1.0, -1.0], n - 1) * difference.std(ddof=1) * np.sqrt((n - 2) / (n - 1))
    assert detectable(spread, 0.95) <= 0.7 * (1 + 1e-2)
    assert detectable(fewer, 0.95) > 0.7 * (1 - 1e-2)


def test_it_is_the_number_that_finds_a_planted_effect_four_times_in_five():
    rng = np.random.default_rng(2)
    n = seeds_needed(rng.normal(0, 1, 2000), 0.8, 0.95)
    found = [sign_flip_p(rng.normal(0.8, 1, n), rng) <= 0.05 for _ in range(200)]
    assert 0.7 <= np.mean(found) <= 0.9


def test_nothing_is_said_where_nothing_is_known():
    assert seeds_needed(np.array([1.0]), 0.5, 0.95) is None
    assert seeds_needed(np.array([1.0, np.nan]), 0.5, 0.95) is None
    assert np.isnan(detectable(np.array([1.0]), 0.95))


def test_an_effect_that_would_take_endless_seeds_has_no_number():
    assert seeds_needed(np.array([-1.0, 1.0, 2.0]), 1e-3, 0.95) is None
    assert seeds_needed(np.array([-1.0, 1.0, 2.0]), 0.1, 0.95) < MOST_SEEDS
