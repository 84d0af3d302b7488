"""More than a mean: how runs lie over seeds, and when they reach a threshold."""

import warnings
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


def interquartile_mean(values: Array) -> float:
    """Mean of the middle half of `values` [n] (Agarwal et al., 2021): a few runs that fail do not move it far."""
    return float(stats.trim_mean(values, 0.25))


def interquartile_mean_interval(
    values: Array, confidence: float, resamples: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Percentile bootstrap interval of the interquartile mean; the order of `values` [n] does not matter."""
    values = np.sort(values)
    drawn = values[rng.integers(0, len(values), (resamples, len(values)))]
    low, high = np.quantile(stats.trim_mean(drawn, 0.25, axis=1), [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


def performance_profile(score: Array, thresholds: Array) -> Array:
    """Share of runs [thresholds] whose `score` [n] is at or below each threshold (Dolan and More, 2002, for costs).

    A run whose score is not finite is above every threshold.
    """
    known = np.where(np.isfinite(score), score, np.inf)
    shares: Array = (known[None, :] <= thresholds[:, None]).mean(axis=1)
    return shares


class Reached(NamedTuple):
    """Kaplan-Meier: at `steps` [k] the share of runs that has reached the threshold, with its interval."""

    steps: Array
    share: Array
    low: Array
    high: Array


def kaplan_meier(steps: Array, reached: NDArray[np.bool_], confidence: float) -> Reached:
    """Share of runs that have reached a threshold by each step at which one of them did (Kaplan and Meier, 1958).

    `steps` [n]: when a run reached it, or its end where it did not (`reached` [n] is false). The interval is
    log-log Greenwood's, and so lies within 0 and 1; where it is not defined (all or none reached) it is the share.
    """
    if not reached.any():
        return Reached(*(np.zeros(0) for _ in range(4)))
    data = stats.CensoredData(uncensored=steps[reached], right=steps[~reached])
    found = stats.ecdf(data)
    at = found.cdf.quantiles
    with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The confidence interval is undefined", RuntimeWarning)
        between = found.cdf.confidence_interval(confidence, method="log-log")
    moments = np.isin(at, steps[reached])
    curves: list[Any] = [found.cdf, between.low, between.high]
    share, low, high = (part.probabilities for part in curves)
    low, high = (np.where(np.isfinite(part), part, share) for part in (low, high))
    return Reached(*(np.asarray(part[moments], dtype=np.float64) for part in (at, share, low, high)))
