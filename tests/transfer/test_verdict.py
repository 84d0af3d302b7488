import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from maglev_offline.transfer.verdict import enough_seeds, judge, mean_interval, paired_effect

NAN = float("nan")


def effect(baseline, arm, *, margin=0.1, confidence=0.95, resamples=500, seed=0):
    return paired_effect(
        np.asarray(baseline, dtype=float),
        np.asarray(arm, dtype=float),
        margin=margin,
        confidence=confidence,
        resamples=resamples,
        rng=np.random.default_rng(seed),
    )


@pytest.mark.parametrize(
    ("low", "high", "margin", "verdict"),
    [
        (1, 2, 0.5, "positive"),
        (-2, -1, 0.5, "negative"),
        (0.2, 2, 0.5, "positive"),  # surely above zero, perhaps within the margin
        (-2, -0.2, 0.5, "negative"),
        (0.1, 0.4, 0.5, "equivalent"),  # surely there, and surely too small to matter
        (-0.4, -0.1, 0.5, "equivalent"),
        (-0.5, 0.5, 0.5, "equivalent"),
        (0, 0, 0, "equivalent"),
        (-0.6, 0.4, 0.5, "inconclusive"),
        (0, 2, 0.5, "inconclusive"),
        (-2, 0, 0.5, "inconclusive"),
        (NAN, 1, 0.5, "inconclusive"),
        (-1, NAN, 0.5, "inconclusive"),
    ],
)
def test_an_interval_is_read_as_the_protocol_says(low, high, margin, verdict):
    assert judge(low, high, margin) == verdict


def test_an_arm_against_itself_is_equivalent():
    costs = np.random.default_rng(0).normal(10, 3, 8)
    found = effect(costs, costs)
    assert (found.difference, found.low, found.high, found.probability_better) == (0, 0, 0, 0.5)
    assert found.verdict == "equivalent"


@pytest.mark.parametrize(("planted", "verdict"), [(-2.0, "positive"), (2.0, "negative"), (0.01, "equivalent")])
def test_a_planted_effect_is_found_with_its_sign_and_size(planted, verdict):
    rng = np.random.default_rng(1)
    baseline = rng.normal(10, 5, 8)
    found = effect(baseline, baseline + planted + rng.normal(0, 0.02, 8), margin=0.2)
    assert found.verdict == verdict
    assert found.difference == pytest.approx(-planted, abs=0.05)
    assert found.low <= found.difference <= found.high
    assert found.arm_mean - found.baseline_mean == pytest.approx(-found.difference)


def test_noise_much_larger_than_the_effect_is_inconclusive():
    rng = np.random.default_rng(2)
    assert effect(rng.normal(10, 5, 8), rng.normal(10, 5, 8)).verdict == "inconclusive"


def test_pairing_by_seed_finds_what_the_spread_of_seeds_would_hide():
    baseline = np.array([1.0, 10, 100, 1000, 50, 500, 5, 20])
    assert effect(baseline, baseline - 1 - 0.01 * np.arange(8)).verdict == "positive"
    shifted = np.roll(baseline, 1)
    assert effect(baseline, shifted - 1 - 0.01 * np.arange(8)).verdict == "inconclusive"


@pytest.mark.parametrize("seeds", [8, 20])
def test_the_interval_covers_the_truth_as_often_as_it_says(seeds):
    # Nominal 95 %; the floor leaves three standard errors of 500 studies. Without the widening for few seeds, 3000
    # studies gave 88.4 % with 8 seeds and 92.8 % with 20.
    rng = np.random.default_rng(1)
    covered = 0
    for study in range(500):
        low, high = mean_interval(rng.normal(1.0, 1.0, seeds), 0.95, 500, np.random.default_rng(study))
        covered += low <= 1.0 <= high
    assert 0.92 <= covered / 500 <= 0.98


@pytest.mark.parametrize(("seeds", "ceiling"), [(2, 0.0), (5, 0.0), (8, 0.09), (20, 0.09)])
def test_equal_arms_get_a_verdict_no_more_often_than_the_confidence_admits(seeds, ceiling):
    # Nominal 5 %; the ceiling leaves three standard errors of 300 studies.
    rng = np.random.default_rng(3)
    alarms = 0
    for study in range(300):
        baseline, arm = rng.normal(0, 1, (2, seeds))
        interval = mean_interval(np.sort(baseline - arm), 0.95, 500, np.random.default_rng(study))
        alarms += judge(*interval, 1e-9) in ("positive", "negative")
    assert alarms / 300 <= ceiling


@settings(deadline=None, max_examples=25)
@given(st.permutations(list(range(7))))
def test_the_order_of_the_seeds_does_not_matter(order):
    rng = np.random.default_rng(4)
    baseline, arm = rng.normal(10, 1, (2, 7))
    for found, expected in zip(effect(baseline[order], arm[order]), effect(baseline, arm), strict=True):
        assert found == expected if isinstance(expected, str) else found == pytest.approx(expected, rel=1e-12)


def test_swapping_the_arms_turns_the_verdict_round():
    rng = np.random.default_rng(5)
    good, bad = rng.normal(1, 0.2, 10), rng.normal(3, 0.2, 10)
    assert (effect(bad, good).verdict, effect(good, bad).verdict) == ("positive", "negative")
    assert effect(bad, good).probability_better == 1
    assert effect(good, bad).probability_better == 0


def test_one_seed_is_inconclusive_and_has_no_interval():
    found = effect([5.0], [1.0])
    assert found.verdict == "inconclusive"
    assert found.difference == 4
    assert np.isnan([found.low, found.high, found.detectable]).all()


def test_seeds_too_few_for_the_confidence_are_inconclusive_however_large_the_effect():
    baseline = np.linspace(9, 10, 6)
    assert effect(baseline[:5], baseline[:5] ** 0.5).verdict == "inconclusive"
    assert effect(baseline, baseline**0.5).verdict == "positive"
    assert [n for n in range(1, 12) if not enough_seeds(n, 0.95)] == [1, 2, 3, 4, 5]
    assert [n for n in range(1, 12) if not enough_seeds(n, 0.8)] == [1, 2, 3]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_cost_that_is_no_number_is_inconclusive(value):
    baseline = np.linspace(1, 2, 8)
    found = effect(baseline, np.where(np.arange(8) == 3, value, baseline))
    assert found.verdict == "inconclusive"
    assert np.isnan([found.low, found.high]).all()


def test_ties_count_half():
    assert effect([1, 2, 3, 4], [1, 1, 4, 3]).probability_better == (2 + 0.5) / 4


def test_the_detectable_difference_is_found_with_a_power_of_80_percent():
    rng = np.random.default_rng(6)
    n, sd = 8, 1.0
    exact = (stats.t(n - 1).ppf(0.975) + stats.t(n - 1).ppf(0.8)) * sd / np.sqrt(n)
    difference = rng.normal(0, 1, n)
    difference *= sd / difference.std(ddof=1)
    assert effect(difference, np.zeros(n)).detectable == pytest.approx(exact)
    studies = rng.normal(exact, sd, (4000, n))
    shown = np.abs(stats.ttest_1samp(studies, 0.0, axis=1).pvalue) < 0.05
    assert shown.mean() == pytest.approx(0.8, abs=0.03)


def test_arms_that_are_not_paired_are_refused():
    with pytest.raises(ValueError, match="paired by seed"):
        effect([1.0, 2.0], [1.0])
