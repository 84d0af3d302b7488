"""`coverage`: rows as far from each other as can be, so that every row has a chosen one near it (k-centre).

Distances are Euclidean in the box of `grid.unit`: each axis over the range between its edge quantiles.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.candidates import Candidates
from maglev_offline.curate.balance.grid import unit
from maglev_offline.curate.balance.quota import balanced_choice
from maglev_offline.curate.settings import CurateSettings

Points = NDArray[np.float32]

FINEST_BINS = 64
COARSER = 0.84
"""Intervals of an axis of the grid that thins the rows out, and what each next grid has of them: half the cells."""

MOST_POINTS, MOST_DISTANCES = 200_000, 2_000_000_000
"""So many rows are left to choose among at most, and so many distances are reckoned: seconds on one core."""


class Thinned(NamedTuple):
    """`row` [m]: one row drawn from each filled cell of the grid; `cell` [n] of each row; `bins` of each axis."""

    row: NDArray[np.int64]
    cell: NDArray[np.int64]
    bins: int


def coverage(candidates: Candidates, settings: CurateSettings, rng: np.random.Generator) -> NDArray[np.int64]:
    """Thin the rows out to one for each cell of a fine grid, then take the farthest one again and again.

    With d axes and `bins` intervals each, no row is farther than 2 r + sqrt(d) / bins from a chosen one, where r is
    the least radius that so many rows can have: 2 r for the greedy choice (Gonzalez, Theoretical Computer Science 38,
    1985), and the diagonal of a cell for the thinning. Where there are fewer cells than rows wanted, each
    cell gives its share: nothing is farther than the diagonal then.
    """
    target, n = settings.target_rows, len(candidates.cost)
    if n <= target:
        return np.arange(n)
    points = unit_points(candidates.values, settings.edge_quantile)
    thin = thinned(points, max(1, min(MOST_POINTS, MOST_DISTANCES // target)), rng)
    if len(thin.row) <= target:
        return balanced_choice(thin.cell, target, rng)
    first = int(rng.integers(len(thin.row)))
    return np.sort(thin.row[farthest_first(points[:, thin.row], target, first)])


def unit_points(values: NDArray[np.float64], edge_quantile: float) -> Points:
    """The rows of `values` [n, d] in the unit box, as [d, n] in single precision."""
    points = np.empty(values.shape[::-1], dtype=np.float32)
    for d, axis in enumerate(points):
        axis[:] = unit(values[:, d], edge_quantile)
    return points


def thinned(points: Points, most: int, rng: np.random.Generator) -> Thinned:
    """Thin out `points` [d, n] by the finest grid that has `most` filled cells or fewer; `most` >= 1."""
    bins = FINEST_BINS
    while True:
        cell = _grid(points, bins)
        filled = np.zeros(bins ** len(points), dtype=np.bool_)
        filled[cell] = True
        if np.count_nonzero(filled) <= most:
            break
        bins = max(1, int(bins * COARSER))
    shuffled = rng.permutation(len(cell))
    row = np.full(len(filled), -1, dtype=np.int64)
    row[cell[shuffled]] = shuffled  # the last one stays
    return Thinned(row[filled], cell, bins)


def _grid(points: Points, bins: int) -> NDArray[np.int64]:
    cell = np.zeros(points.shape[1], dtype=np.int64)
    for axis in points:
        cell *= bins
        cell += np.minimum((axis * bins).astype(np.int32), bins - 1)
    return cell


def farthest_first(points: Points, count: int, first: int) -> NDArray[np.int64]:
    """`count` of the `points` [d, m] from the `first` on, each the farthest from all before it; no point twice.

    Element by element, not as a product of matrices, whose last digit would depend on the processor.
    """
    chosen = np.empty(count, dtype=np.int64)
    nearest = np.full(points.shape[1], np.inf, dtype=np.float32)
    squared, part = np.empty_like(nearest), np.empty_like(nearest)
    now = first
    for k in range(count):
        chosen[k] = now
        squared[:] = 0
        for axis in points:
            np.subtract(axis, axis[now], out=part)
            np.multiply(part, part, out=part)
            np.add(squared, part, out=squared)
        np.minimum(nearest, squared, out=nearest)
        nearest[now] = -1
        now = int(np.argmax(nearest))
    return chosen
