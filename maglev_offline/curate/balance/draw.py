"""Draws without replacement in which rows have weights."""

import numpy as np
from numpy.typing import NDArray


def weighted_draw(weight: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw `count` of the rows, one after another, each time in proportion to the `weight` [n] > 0 of those left.

    Exponential arrival times of these rates: the first to come are the draw (Efraimidis and Spirakis, Information
    Processing Letters 97, 2006). Returns sorted row numbers; all rows if there are too few.
    """
    if len(weight) <= count:
        return np.arange(len(weight))
    arrival = rng.standard_exponential(len(weight))
    arrival /= weight
    return np.sort(np.argpartition(arrival, count - 1)[:count])
