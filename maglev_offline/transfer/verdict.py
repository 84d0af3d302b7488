"""Paired statistics over seeds, and the verdict in words."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from maglev_offline.transfer.distributions import interquartile_mean, interquartile_mean_interval
from maglev_offline.transfer.multiple import sign_flip_p
from maglev_offline.transfer.power import detectable, seeds_needed

Array = NDArray[np.float64]

Verdict = Literal["positive", "negative", "equivalent", "inconclusive"]


class Effect(NamedTuple):
    """What prefill changed in one metric: differences are baseline - arm of costs, so positive means it helps.

    `interquartile`: the interquartile mean of the differences, and its interval. `probability_better`: share of the
    seeds for which the arm is better, ties counted half. `p_value`: of the mean, by changes of sign. `detectable`: the
    smallest mean difference that so many seeds show with a power of 80 % at this confidence (paired t test);
    `seeds_needed`: how many would show one of the size of the margin, None where more than 10,000.
    """

    difference: float
    low: float
    high: float
    baseline_mean: float
    arm_mean: float
    interquartile: float
    interquartile_low: float
    interquartile_high: float
    probability_better: float
    p_value: float
    detectable: float
    seeds_needed: int | None
    margin: float
    seeds: int
    verdict: Verdict


def paired_effect(
    baseline: Array,
    arm: Array,
    *,
    margin: float,
    confidence: float,
    resamples: int,
    rng: np.random.Generator,
) -> Effect:
    """Compare two arms seed by seed: mean difference with a bootstrap interval (BCa), and its verdict.

    `baseline` and `arm` hold a cost-like metric [seeds], the same seeds in the same order; `margin` is the smallest
    effect of interest in the metric's own unit. The order of the seeds does not matter. A number that is not finite,
    or fewer seeds than can show anything at this confidence, have no interval (NaN) and make it inconclusive.
    """
    if baseline.shape != arm.shape or baseline.ndim != 1:
        raise ValueError(f"arms must be paired by seed, got {baseline.shape} and {arm.shape}")
    difference = np.sort(baseline - arm)
    low, high = mean_interval(difference, confidence, resamples, rng)
    middle = (float("nan"), float("nan"))
    if not np.isnan(low):
        middle = interquartile_mean_interval(difference, confidence, resamples, rng)
    return Effect(
        difference=float(difference.mean()),
        low=low,
        high=high,
        baseline_mean=float(baseline.mean()),
        arm_mean=float(arm.mean()),
        interquartile=interquartile_mean(difference),
        interquartile_low=middle[0],
        interquartile_high=middle[1],
        probability_better=float((difference > 0).mean() + 0.5 * (difference == 0).mean()),
        p_value=sign_flip_p(difference, rng),
        detectable=detectable(difference, confidence),
        seeds_needed=seeds_needed(difference, margin, confidence),
        margin=margin,
        seeds=len(difference),
        verdict=judge(low, high, margin),
    )


def enough_seeds(seeds: int, confidence: float) -> bool:
    """Whether chance alone puts all differences on one side of zero more rarely than 1 - `confidence`.

    A bootstrap of the mean never leaves the range of the differences: between equal arms, fewer seeds (than 6 at
    95 %) would give a false verdict more often than the confidence admits, with 2 seeds every other time.
    """
    return 2.0 ** (1 - seeds) <= 1 - confidence


def judge(low: float, high: float, margin: float) -> Verdict:
    """Read an interval: excludes zero -> positive or negative; within the margin -> equivalent; else inconclusive.

    An effect that is surely there, but surely smaller than the margin, is equivalent.
    """
    if np.isnan(low) or np.isnan(high):
        return "inconclusive"
    if -margin <= low and high <= margin:
        return "equivalent"
    if low > 0:
        return "positive"
    if high < 0:
        return "negative"
    return "inconclusive"


def mean_interval(
    difference: Array, confidence: float, resamples: int, rng: np.random.Generator
) -> tuple[float, float]:
    """BCa interval of the mean, widened for few seeds; too few have none, equal differences have one of no width."""
    if not enough_seeds(len(difference), confidence) or not np.isfinite(difference).all():
        return float("nan"), float("nan")
    if np.ptp(difference) <= 1e-12 * max(1.0, float(np.abs(difference).max())):
        return float(difference[0]), float(difference[0])
    result = stats.bootstrap(
        (difference,),
        np.mean,
        confidence_level=expanded_level(len(difference), confidence),
        n_resamples=resamples,
        method="BCa",
        rng=rng,
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)


def expanded_level(seeds: int, confidence: float) -> float:
    """Nominal level at which a bootstrap of so few seeds covers with `confidence` (Hesterberg 2015, Sec. 5.3).

    A bootstrap interval is too narrow by sqrt((n - 1) / n), and by normal instead of t quantiles. As it comes, BCa at
    95 % covers the mean of 8 normal differences 90 % of the time; expanded, 95 %. Skewed ones are covered less: 86 %
    for 8 lognormal differences (docs/protocol.md).
    """
    spread = np.sqrt(seeds / (seeds - 1)) * stats.t(seeds - 1).ppf((1 + confidence) / 2)
    return float(1 - 2 * stats.norm.cdf(-spread))
