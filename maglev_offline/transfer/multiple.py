"""Many comparisons at once: how surprising the smallest of many differences is."""

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
Key = TypeVar("Key")

FLIPS = 9_999
"""So many random changes of sign where the seeds are too many for all of them; the smallest p is then 2e-4, so a family
of more than 250 comparisons can hold nothing at 95 % after Holm."""


def sign_flip_p(difference: Array, rng: np.random.Generator) -> float:
    """Two-sided p-value of the mean of paired differences [n], by a permutation test that changes their signs.

    If the arms are equal, each difference is as likely with the other sign (Fisher, 1935). Exact up to 13 seeds. Equal
    arms, and differences that are not finite, have 1.
    """
    if not np.isfinite(difference).all() or not np.any(difference):
        return 1.0
    if len(difference) < 2:
        return 1.0
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


def holm(p_values: Mapping[Key, float]) -> dict[Key, float]:
    """Adjusted p-values (Holm, 1979): below alpha, the chance of any false finding in the family is below alpha."""
    order = sorted(p_values, key=lambda key: p_values[key])
    adjusted, worst = {}, 0.0
    for rank, key in enumerate(order):
        worst = max(worst, min(1.0, (len(order) - rank) * p_values[key]))
        adjusted[key] = worst
    return {key: adjusted[key] for key in p_values}
