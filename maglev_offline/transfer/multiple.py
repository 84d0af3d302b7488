"""Many comparisons at once: how surprising the smallest of many differences is."""

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
Key = TypeVar("Key")

EXACT_SEEDS = 30
"""Up to so many seeds all changes of sign are counted; two tables of 2^15 sums do it."""

FLIPS = 9_999
"""So many random changes of sign for more seeds; the smallest p is then 2e-4, so a family of more than 250 comparisons
can hold nothing at 95 % after Holm."""


def sign_flip_p(difference: Array, rng: np.random.Generator) -> float:
    """Two-sided p-value of the mean of paired differences [n], by a permutation test that changes their signs.

    If the arms are equal, each difference is as likely with the other sign (Fisher, 1935). Exact up to `EXACT_SEEDS`.
    Equal arms, one seed, and differences that are not finite have 1.
    """
    if len(difference) < 2 or not np.isfinite(difference).all() or not np.any(difference):
        return 1.0
    if len(difference) <= EXACT_SEEDS:
        return _share_as_far(np.sort(difference))
    found = stats.permutation_test(
        (np.sort(difference),),
        np.mean,
        permutation_type="samples",
        n_resamples=FLIPS,
        vectorized=True,
        axis=-1,
        rng=rng,
    )
    return float(found.pvalue)


def _share_as_far(difference: Array) -> float:
    """Share of all changes of sign whose sum is as far from zero as the sum found, counted from sums of two halves."""
    size = np.abs(difference)
    left, right = (_signed_sums(half) for half in np.array_split(size, 2))
    right = np.sort(right)
    # Sums that are equal but for rounding are as far.
    least = abs(float(difference.sum())) - 1e-9 * float(size.sum())
    above = len(right) - np.searchsorted(right, least - left, side="left")
    # With every pattern comes its mirror, so that as many sums lie below the other end.
    return min(1.0, float(2 * above.sum() / (len(left) * len(right))))


def _signed_sums(values: Array) -> Array:
    """The sums of `values` [n] under all changes of sign [2^n]."""
    sums = np.zeros(1)
    for value in values:
        sums = np.concatenate([sums - value, sums + value])
    return sums


def holm(p_values: Mapping[Key, float]) -> dict[Key, float]:
    """Adjusted p-values (Holm, 1979): below alpha, the chance of any false finding in the family is below alpha."""
    order = sorted(p_values, key=lambda key: p_values[key])
    adjusted, worst = {}, 0.0
    for rank, key in enumerate(order):
        worst = max(worst, min(1.0, (len(order) - rank) * p_values[key]))
        adjusted[key] = worst
    return {key: adjusted[key] for key in p_values}
