"""Does the target-error diagnostic, known before any training, foretell what a prefill does?"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.agents.settings import Algorithm

Array = NDArray[np.float64]

NUMBERS = ("error_over_advantage_std", "correlation_with_advantage")
"""What of a diagnostic is held against the outcome."""

LEAST_GROUPS = 4
"""Of fewer groups of arms a rank correlation says nothing."""


class Foretold(NamedTuple):
    """Spearman's rank correlation of one number of the diagnostic with the outcome, over `arms`; None: too few.

    `groups`: how many groups of arms the interval is over; arms that share their rows are one.
    """

    rank_correlation: float | None
    interval: tuple[float, float] | None
    arms: int
    groups: int


def rank_correlation(
    number: Array,
    outcome: Array,
    confidence: float,
    resamples: int,
    rng: np.random.Generator,
    groups: Sequence[str] | None = None,
) -> Foretold:
    """Correlate over arms [n], with a percentile bootstrap interval that draws groups of arms (each its own if None).

    Arms that share their rows foretell as one, however many they are. Resamples in which one side does not vary have no
    rank correlation and are left out.
    """
    n = len(number)
    names, member = np.unique(np.arange(n).astype(str) if groups is None else groups, return_inverse=True)
    many = len(names)
    if many < LEAST_GROUPS or np.ptp(number) == 0 or np.ptp(outcome) == 0:
        return Foretold(None, None, n, many)
    draws = rng.multinomial(many, np.full(many, 1 / many), resamples)[:, member].astype(np.float64)
    found = _spearman(number, outcome, draws)
    low, high = np.nanquantile(found, [(1 - confidence) / 2, (1 + confidence) / 2])
    whole = float(_spearman(number, outcome, np.ones((1, n)))[0])
    return Foretold(whole, (float(low), float(high)), n, many)


def _spearman(a: Array, b: Array, weight: Array) -> Array:
    """Rank correlations of `a` with `b` [n] in samples that hold each pair `weight` [m, n] times; NaN: no variation."""
    x, y = (_ranks(values, weight) for values in (a, b))
    total = weight.sum(axis=1, keepdims=True)
    x, y = (rank - (weight * rank).sum(axis=1, keepdims=True) / total for rank in (x, y))
    spread = (weight * x**2).sum(axis=1) * (weight * y**2).sum(axis=1)
    known = spread > 1e-9
    found: Array = np.full(len(weight), np.nan)
    found[known] = (weight * x * y).sum(axis=1)[known] / np.sqrt(spread[known])
    return found


def _ranks(values: Array, weight: Array) -> Array:
    """The ranks [m, n] of `values` [n] in samples that hold each `weight` [m, n] times; equal ones share their mean."""
    distinct, place = np.unique(values, return_inverse=True)
    held = weight @ np.eye(len(distinct))[place]
    middle = held.cumsum(axis=1) - held + (held + 1) / 2
    ranks: Array = middle[:, place]
    return ranks


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
    groups: Mapping[str, str],
) -> dict[str, Any]:
    """Hold the diagnostic of each arm's rows (`rows`, by arm) against the effect on `metric`, by algorithm.

    `groups`: by arm, what it shares its rows with. Arms whose diagnostic has no number are left out. A good
    foreteller has an error that correlates negatively with the difference (empty minus arm), and a correlation that
    correlates positively.
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
            points = {arm: (b[name], a["difference"]) for arm, (b, a) in judged.items() if b[name] is not None}
            number, outcome = np.array(list(points.values()), dtype=np.float64).reshape(-1, 2).T
            told = rank_correlation(number, outcome, confidence, resamples, rng, [groups[arm] for arm in points])
            found["algorithms"][algorithm][name] = told._asdict()
    found["calibration"] = calibration(pairs)
    return found
