"""How far the estimates can be trusted: a sandwich over blocks, the spread over left-out logs, correlations."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from maglev_offline.identify.equations import Values
from maglev_offline.identify.fit import Fit, influence
from maglev_offline.identify.settings import Loss, Name
from maglev_offline.identify.windows import Windows

Array = NDArray[np.float64]

FLAT = 1e-7
"""Directions in which the residuals move by less than this share of the steepest one are flat."""


@dataclass(frozen=True)
class Uncertainty:
    """Standard errors (SI; infinite where flat) and half widths, correlation [p, p], condition number, blocks."""

    error: Values
    half_width: Values
    correlation: Array
    condition: float
    blocks: int
    block_rows: int
    method: dict[Name, str]


def blocks_of(windows: Windows, residual: Array, equations: int, at_least: int) -> tuple[NDArray[np.int64], int]:
    """Number the blocks of consecutive windows [n], and say how many rows a block spans.

    A block spans two windows, or five times the integrated autocorrelation time of the residuals if that is longer;
    less, down to one window, where there would be fewer than `at_least` blocks.
    """
    n = len(windows)
    longest = max(_memory(part, windows.stretch) for part in np.split(residual, equations)) * windows.stride
    length = max(2 * windows.kernel.support, round(5 * longest))
    while True:
        part = windows.middle // length
        new = np.ones(n, dtype=bool)
        new[1:] = (np.diff(windows.stretch) != 0) | (np.diff(part) != 0)
        number = np.cumsum(new) - 1
        if number[-1] + 1 >= at_least or length <= windows.kernel.support:
            return number, length
        length = max(windows.kernel.support, length * 3 // 4)


def _memory(residual: Array, stretch: NDArray[np.int64]) -> float:
    """Integrated autocorrelation time in windows, up to the first lag whose correlation is below 0.05."""
    centred = residual - residual.mean()
    power, total = float(centred @ centred), 1.0
    if power == 0:
        return total
    for lag in range(1, min(len(centred) // 4, 2000)):
        together = stretch[lag:] == stretch[:-lag]
        correlation = float(np.sum((centred[lag:] * centred[:-lag])[together])) / power
        if correlation < 0.05:
            break
        total += 2 * correlation
    return total


def uncertainty(
    fitted: Fit, wider: Fit | None, windows: Windows, folds: list[Fit], loss: Loss, confidence: float
) -> Uncertainty:
    """Standard errors by the sandwich over blocks, or by the jackknife over `folds` where that is larger.

    The sandwich (J' D J)^-1 (sum over blocks of g g') (J' D J)^-1, with g the sum of J' psi over both equations of a
    block, holds whatever the correlation inside a block and between the equations. The jackknife sees what changes
    from log to log, which no block inside a log does. Neither sees a bias (noise in the regressors, what happens
    between the rows): twice the shift of the estimate under a `wider` window, where a bias differs, is added in
    quadrature to the standard error, and whole to the half width.
    """
    names, p = fitted.names, len(fitted.names)
    number, rows = blocks_of(windows, fitted.residual, len(fitted.equations), 2 * p + 2)
    count = int(number[-1]) + 1
    pull, slope = influence(fitted.residual, loss)
    norm = np.linalg.norm(fitted.jacobian, axis=0)
    norm[norm == 0] = 1.0
    jacobian = fitted.jacobian / norm
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    flat = singular < FLAT * singular[0]
    gradient = np.zeros((count, p))
    np.add.at(gradient, np.tile(number, len(fitted.equations)), jacobian * pull[:, None])
    bread = np.linalg.pinv((jacobian * slope[:, None]).T @ jacobian, rcond=FLAT**2, hermitian=True)
    meat = gradient.T @ gradient * count / max(count - p, 1)
    covariance = bread @ meat @ bread
    error = np.sqrt(np.diag(covariance).clip(0)) / norm
    error[(np.abs(directions[flat]) > 0.05).any(axis=0)] = np.inf
    correlation = _correlation(jacobian, slope)
    jackknife = _jackknife(fitted, folds)
    found: Values = {}
    half: Values = {}
    method: dict[Name, str] = {}
    for k, name in enumerate(names):
        block, spread = float(error[k]) * fitted.scale[name], jackknife.get(name, 0.0)
        freedom = max(count - p, 1) if block >= spread else len(folds) - 1
        shift = 0.0 if wider is None else 2 * abs(wider.values[name] - fitted.values[name])
        half[name] = max(block, spread) * float(student.ppf(0.5 + confidence / 2, freedom)) + shift
        found[name] = float(np.hypot(max(block, spread), shift))
        method[name] = f"sandwich over {count} blocks" if block >= spread else f"jackknife over {len(folds)} pieces"
        if shift > max(block, spread):
            method[name] += ", mostly the shift under a wider window"
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else float("inf")
    return Uncertainty(found, half, correlation, condition, count, rows, method)


def _correlation(jacobian: Array, slope: Array) -> Array:
    """Correlation of the estimates, from the curvature of the cost alone."""
    inverse = np.linalg.pinv((jacobian * slope[:, None]).T @ jacobian, rcond=1e-15, hermitian=True)
    root = np.sqrt(np.diag(inverse).clip(1e-300))
    correlation: Array = (inverse / np.outer(root, root)).clip(-1, 1)
    return correlation


def _jackknife(fitted: Fit, folds: list[Fit]) -> Values:
    n = len(folds)
    if n < 3:
        return {}
    return {
        name: float(np.sqrt((n - 1) / n * np.sum((v - v.mean()) ** 2)))
        for name in fitted.names
        for v in [np.array([fold.values[name] for fold in folds])]
    }
