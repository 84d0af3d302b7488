"""How many seeds a study needs, and what so many seeds can show: power of the paired t test."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]

POWER = 0.8
MOST_SEEDS = 10_000


def detectable(difference: Array, confidence: float) -> float:
    """Smallest mean difference that as many seeds as there are in `difference` [n] show with a power of 80 %."""
    if len(difference) < 2 or not np.isfinite(difference).all():
        return float("nan")
    return _detectable(float(difference.std(ddof=1)), len(difference), confidence)


def seeds_needed(difference: Array, effect: float, confidence: float) -> int | None:
    """Fewest seeds that show a mean difference of `effect` with a power of 80 %, if they scatter as `difference` [n].

    None where too few seeds were run to know the scatter, or where more than `MOST_SEEDS` were needed.
    """
    if len(difference) < 2 or not np.isfinite(difference).all() or effect <= 0:
        return None
    std = float(difference.std(ddof=1))
    if _detectable(std, MOST_SEEDS, confidence) > effect:
        return None
    least = math.ceil(1 - math.log2(1 - confidence))  # fewer have no interval: `verdict.enough_seeds`
    few, many = least - 1, MOST_SEEDS
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (few, middle) if _detectable(std, middle, confidence) <= effect else (middle, many)
    return many


def _detectable(std: float, seeds: int, confidence: float) -> float:
    t = stats.t(seeds - 1)
    return float((t.ppf((1 + confidence) / 2) + t.ppf(POWER)) * std / np.sqrt(seeds))
