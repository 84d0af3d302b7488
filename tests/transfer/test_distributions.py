import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.transfer.distributions import (
    interquartile_mean,
    interquartile_mean_interval,
    kaplan_meier,
    performance_profile,
)


def test_the_interquartile_mean_is_that_of_the_middle_half():
    assert interquartile_mean(np.array([-1e9, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1e9])) == 3.5


def test_its_interval_covers_at_the_nominal_rate():
    rng = np.random.default_rng(0)
    hits = []
    for _ in range(200):
        low, high = interquartile_mean_interval(rng.normal(size=20), 0.95, 300, rng)
        hits.append(low <= 0 <= high)
    assert 0.88 <= np.mean(hits) <= 0.99


def test_the_order_of_seeds_does_not_matter_to_the_interval():
    values = np.random.default_rng(1).normal(size=12)
    one, other = (
        interquartile_mean_interval(order, 0.95, 200, np.random.default_rng(0)) for order in (values, values[::-1])
    )
    assert one == other


def test_a_profile_is_the_share_at_or_below_each_threshold_and_lost_runs_are_above_all():
    shares = performance_profile(np.array([1.0, 2.0, np.nan, np.inf]), np.array([0.5, 1.0, 2.0, 1e9]))
    np.testing.assert_array_equal(shares, [0, 0.25, 0.5, 0.5])


def test_kaplan_meier_without_censoring_is_the_share_that_has_reached():
    found = kaplan_meier(np.array([10.0, 20.0, 20.0, 40.0]), np.ones(4, bool), 0.95)
    np.testing.assert_array_equal(found.steps, [10, 20, 40])
    np.testing.assert_allclose(found.share, [0.25, 0.75, 1.0])


def test_kaplan_meier_gives_the_textbook_numbers_with_censoring():
    # 6, 6, 6, 6+, 7, 9+, 10, 10+, ...: the treated group of Freireich et al. (1963), as in Cox and Oakes, Table 1.1.
    weeks = np.array([6, 6, 6, 6, 7, 9, 10, 10, 11, 13, 16, 17, 19, 20, 22, 23, 25, 32, 32, 34, 35], float)
    relapsed = np.isin(np.arange(21), [0, 1, 2, 4, 6, 9, 10, 14, 15])
    found = kaplan_meier(weeks, relapsed, 0.95)
    np.testing.assert_array_equal(found.steps, [6, 7, 10, 13, 16, 22, 23])
    np.testing.assert_allclose(1 - found.share, [0.857, 0.807, 0.753, 0.690, 0.627, 0.538, 0.448], atol=5e-4)


def test_where_no_run_reaches_there_is_no_curve():
    assert len(kaplan_meier(np.full(5, 100.0), np.zeros(5, bool), 0.95).steps) == 0


@given(st.lists(st.tuples(st.integers(1, 20), st.booleans()), min_size=1, max_size=15))
@settings(max_examples=50)
def test_shares_rise_and_stay_within_their_interval(runs):
    steps, reached = np.array([s for s, _ in runs], float), np.array([r for _, r in runs])
    found = kaplan_meier(steps, reached, 0.95)
    assert (np.diff(found.share) >= 0).all()
    assert (found.low <= found.share + 1e-12).all()
    assert (found.share <= found.high + 1e-12).all()
    assert found.share[-1:] == pytest.approx(found.share[-1:].clip(0, 1))
