"""Does the target-error diagnostic, known before any training, foretell what a prefill does?"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from maglev_offline.agents.settings import Algorithm

Array = NDArray[np.float64]

NUMBERS = ("error_over_advantage_std", "correlation_with_advantage")
"""What of a diagnostic is held against the outcome."""

LEAST_ARMS = 4
"""Of fewer arms a rank correlation says nothing."""


class Foretold(NamedTuple):
    """Spearman's rank correlation of one number of the diagnostic with the outcome, over `arms`; None: too few."""

    rank_correlation: float | None
    interval: tuple[float, float] | None
    arms: int


def rank_correlation(
    number: Array, outcome: Array, confidence: float, resamples: int, rng: np.random.Generator
) -> Foretold:
    """Correlate over arms [n], with a percentile bootstrap interval over arms.

    Resamples in which one side does not vary have no rank correlation and are left out.
    """
    n = len(number)
    if n < LEAST_ARMS or np.ptp(number) == 0 or np.ptp(outcome) == 0:
        return Foretold(None, None, n)
    draws = rng.integers(0, n, (resamples, n))
    vary = (np.ptp(number[draws], axis=1) > 0) & (np.ptp(outcome[draws], axis=1) > 0)
    found = _spearman(number[draws[vary]], outcome[draws[vary]])
    low, high = np.quantile(found, [(1 - confidence) / 2, (1 + confidence) / 2])
    whole = float(_spearman(number[None], outcome[None])[0])
    return Foretold(whole, (float(low), float(high)), n)


def _spearman(a: Array, b: Array) -> Array:
    """Rank correlations of the rows of `a` and `b` [m, n]."""
    ranks = [stats.rankdata(x, axis=1) for x in (a, b)]
    x, y = (rank - rank.mean(axis=1, keepdims=True) for rank in ranks)
    found: Array = (x * y).sum(axis=1) / np.sqrt((x**2).sum(axis=1) * (y**2).sum(axis=1))
    return found


def calibration(pairs: list[tuple[str, str]]) -> dict[str, dict[str, int]]:
    """How often each verdict before training met each outcome after it: counts by verdict, then by outcome."""
    table: dict[str, dict[str, int]] = {}
    for before, after in pairs:
        row = table.setdefault(before, {})
        row[after] = row.get(after, 0) + 1
    return table


def foretelling(
    rows: dict[str, dict[str, Any]],
    algorithms: Mapping[Algorithm, dict[str, Any]],
    metric: str,
    confidence: float,
    resamples: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Hold the diagnostic of each arm's rows (`rows`, by arm) against the effect on `metric`, by algorithm.

    Arms whose diagnostic has no number are left out. A good foreteller has an error that correlates negatively with
    the difference (empty minus arm), and a correlation that correlates positively.
    """
    found: dict[str, Any] = {"metric": metric, "algorithms": {}, "calibration": {}}
    pairs = []
    for algorithm, facts in algorithms.items():
        judged = {
            arm: (rows[arm]["diagnostic"], effects[metric])
            for arm, effects in facts["effects"].items()
            if rows.get(arm, {}).get("diagnostic") is not None
        }
        pairs += [(before["verdict"], after["verdict"]) for before, after in judged.values()]
        found["algorithms"][algorithm] = {}
        for name in NUMBERS:
            points = [(b[name], a["difference"]) for b, a in judged.values() if b[name] is not None]
            number, outcome = np.array(points, dtype=np.float64).reshape(-1, 2).T
            told = rank_correlation(number, outcome, confidence, resamples, rng)
            found["algorithms"][algorithm][name] = told._asdict()
    found["calibration"] = calibration(pairs)
    return found
