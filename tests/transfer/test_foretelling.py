import numpy as np
import pytest
from scipy import stats

from maglev_offline.transfer.foretelling import calibration, foretelling, rank_correlation


def rng():
    return np.random.default_rng(0)


def test_the_whole_correlation_is_spearmans():
    x, y = np.random.default_rng(1).normal(size=(2, 9))
    found = rank_correlation(x, y, 0.95, 200, rng())
    assert found.rank_correlation == pytest.approx(stats.spearmanr(x, y).statistic)
    assert found.interval[0] <= found.rank_correlation <= found.interval[1]


def test_a_perfect_foreteller_has_a_correlation_of_one():
    x = np.arange(8.0)
    assert rank_correlation(x, x**3, 0.95, 200, rng()) == (
        pytest.approx(1),
        (pytest.approx(1), pytest.approx(1)),
        8,
        8,
    )


@pytest.mark.parametrize(("x", "y"), [([1, 2, 3], [1, 2, 3]), ([1, 1, 1, 1], [1, 2, 3, 4])])
def test_too_few_arms_or_none_that_differ_foretell_nothing(x, y):
    assert rank_correlation(np.array(x, float), np.array(y, float), 0.95, 100, rng())[:2] == (None, None)


def test_arms_that_share_their_rows_count_as_one_for_the_interval():
    x, y = np.random.default_rng(2).normal(size=(2, 6)) + np.arange(6)
    alone = rank_correlation(x, y, 0.95, 2000, rng())
    copied = rank_correlation(
        np.repeat(x, 3), np.repeat(y, 3), 0.95, 2000, rng(), [str(k) for k in range(6) for _ in "abc"]
    )
    assert (copied.arms, copied.groups) == (18, 6)
    assert copied.rank_correlation == pytest.approx(alone.rank_correlation)
    assert copied.interval == pytest.approx(alone.interval, abs=0.02)


def test_groups_that_are_few_foretell_nothing_however_many_arms_there_are():
    x, y = np.random.default_rng(3).normal(size=(2, 12))
    assert rank_correlation(x, y, 0.95, 100, rng(), ["a", "b", "c"] * 4)[:2] == (None, None)


def test_calibration_counts_what_became_of_each_verdict():
    pairs = [("fit", "positive"), ("fit", "equivalent"), ("harmful", "negative"), ("fit", "positive")]
    assert calibration(pairs) == {"fit": {"positive": 2, "equivalent": 1}, "harmful": {"negative": 1}}


def test_arms_whose_error_foretells_their_harm_are_found_so():
    diagnosed = {
        f"arm{k}": {"diagnostic": {"verdict": "fit" if k < 3 else "harmful", "error_over_advantage_std": float(k),
                                   "correlation_with_advantage": 1 - k / 10}}
        for k in range(6)
    }  # fmt: skip
    diagnosed["unjudged"] = {"diagnostic": None}
    effects = {name: {"area": {"difference": -(k**2.0), "verdict": "negative"}} for k, name in enumerate(diagnosed)}
    found = foretelling(
        diagnosed, {"td3": {"effects": effects}}, "area", 0.95, 200, rng(), {arm: arm for arm in diagnosed}
    )
    told = found["algorithms"]["td3"]
    assert told["error_over_advantage_std"]["rank_correlation"] == pytest.approx(-1)
    assert told["correlation_with_advantage"]["rank_correlation"] == pytest.approx(1)
    assert told["error_over_advantage_std"]["arms"] == 6
    assert found["calibration"] == {"fit": {"negative": 3}, "harmful": {"negative": 3}}
