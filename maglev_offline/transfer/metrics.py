"""Transfer metrics of learning curves (Taylor & Stone 2009), on costs: for each of them, smaller is better.

All functions take `steps` [evaluations] and `cost` [seeds, evaluations], and return one number for each seed.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Steps = NDArray[np.int64]


def jumpstart(cost: Array, first: int) -> Array:
    """Mean cost of the first `first` evaluations; the caller leaves out those before the first gradient step.

    The evaluation before it cannot differ between arms: prefill alone does not change the initial weights.
    """
    mean: Array = cost[:, :first].mean(axis=1)
    return mean


def asymptote(cost: Array, last: int) -> Array:
    """Mean cost of the last `last` evaluations."""
    mean: Array = cost[:, -last:].mean(axis=1)
    return mean


def drift(steps: Steps, cost: Array, last: int) -> Array:
    """Change of the least-squares line over the last `last` evaluations; near zero where a run has converged."""
    x = steps[-last:].astype(float)
    x = x - x.mean()
    if len(x) < 2:
        return np.zeros(len(cost))
    slope = (cost[:, -last:] - cost[:, -last:].mean(axis=1, keepdims=True)) @ x / (x @ x)
    change: Array = slope * (x[-1] - x[0])
    return change


def area(steps: Steps, cost: Array) -> Array:
    """Mean height of the curve over the step axis: trapezoidal area over its width."""
    if len(steps) < 2:
        return cost[:, 0].copy()
    mean: Array = np.trapezoid(cost, steps, axis=1) / (steps[-1] - steps[0])
    return mean


class TimeToThreshold(NamedTuple):
    """Steps until the threshold held, and whether it ever did; censored runs carry the length of the run."""

    steps: Array
    reached: NDArray[np.bool_]


def time_to_threshold(steps: Steps, cost: Array, threshold: float, hold: int) -> TimeToThreshold:
    """First step from which `hold` evaluations in a row are at or below the threshold.

    A run that never gets there is censored at its end, never dropped; the mean over seeds is then the restricted mean
    time.
    """
    below = cost <= threshold
    held = np.lib.stride_tricks.sliding_window_view(below, min(hold, below.shape[1]), axis=1).all(axis=2)
    reached = np.any(held, axis=1)
    when = steps[held.argmax(axis=1)].astype(float)
    return TimeToThreshold(np.where(reached, when, float(steps[-1])), reached)
