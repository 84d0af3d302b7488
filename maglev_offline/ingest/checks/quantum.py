"""In which steps a signal is recorded."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quantum(ordered: Array) -> float | None:
    """The step of a signal's values (sorted, shape [n]), or None where they show none.

    A step shows where values come again: where there are fewer than half as many levels as values. Levels may be
    missing and the steps rounded (48 and 49 um of a 48.8 um step): the step is the sum of the distances between
    levels over how many of the least usual distance they hold.
    """
    if len(ordered) < 16:
        return None
    steps = np.diff(ordered)
    steps = steps[steps > 1e-9 * max(abs(float(ordered[0])), abs(float(ordered[-1])))]
    if len(steps) < 4 or 2 * len(steps) > len(ordered):
        return None
    least = float(np.partition(steps, len(steps) // 10)[len(steps) // 10])
    many = np.rint(steps / least)
    near = many <= 20
    if not near.any():
        return None
    step = float(steps[near].sum() / many[near].sum())
    off = np.abs(steps[near] / step - np.rint(steps[near] / step))
    # Levels that do not lie on multiples are not those of a quantiser.
    return step if float(np.mean(off < 0.15)) > 0.8 else None
