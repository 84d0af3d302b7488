"""Balance over the state-action space: equal shares for the cells, as far as they are filled."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.int64]


def cells_of(values: NDArray[np.float64], bins: tuple[int, ...], edge_quantile: float) -> Cells:
    """Number of the cell of each row of `values` [n, d].

    Each dimension is cut into equal intervals between two of its quantiles; rows beyond them belong to the cells at
    the edge, so that single outliers do not stretch the grid.
    """
    low = np.quantile(values, edge_quantile, axis=0)
    high = np.quantile(values, 1 - edge_quantile, axis=0)
    width = np.where(high > low, high - low, 1.0)
    cell = np.zeros(len(values), dtype=np.int64)
    for d, n in enumerate(bins):
        place = np.clip((values[:, d] - low[d]) / width[d], 0.0, 1.0)
        index = np.minimum((place * n).astype(np.int64), n - 1)
        cell = cell * n + index
    return cell


def balanced_choice(cell: Cells, target: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Choose `target` rows so that no cell gives more than another could have given too.

    Every cell gives min(its rows, quota) rows at random; the quota is the largest that does not exceed the target,
    and the remainder comes from cells drawn at random. Returns sorted row numbers; all rows if there are too few.
    """
    n = len(cell)
    if n <= target:
        return np.arange(n)
    order = np.lexsort((rng.permutation(n), cell))
    start = np.flatnonzero(np.diff(cell[order], prepend=cell[order[0]] - 1))
    counts = np.diff(np.append(start, n))
    rank = np.arange(n) - np.repeat(start, counts)
    quota = _quota(counts, target)
    chosen = order[rank < quota]
    spare = order[rank == quota]
    extra = rng.choice(spare, target - len(chosen), replace=False)
    return np.sort(np.concatenate([chosen, extra]))


def _quota(counts: NDArray[np.int64], target: int) -> int:
    """Largest q with sum(min(counts, q)) <= target."""
    low, high = 0, int(counts.max())
    while low < high:
        middle = (low + high + 1) // 2
        if np.minimum(counts, middle).sum() <= target:
            low = middle
        else:
            high = middle - 1
    return low


class Occupancy(NamedTuple):
    """How rows lie over the cells.

    `entropy`: Shannon entropy of the shares, in nats. `effective_cells`: inverse Simpson index, 1 / sum p^2, the
    number of equally filled cells that would be as even.
    """

    rows: int
    occupied_cells: int
    entropy: float
    effective_cells: float


def occupancy(cell: Cells) -> Occupancy:
    """Measure how evenly the rows fill the cells."""
    if len(cell) == 0:
        return Occupancy(0, 0, 0.0, 0.0)
    share = np.unique(cell, return_counts=True)[1] / len(cell)
    return Occupancy(len(cell), len(share), float(-(share * np.log(share)).sum()), float(1 / (share**2).sum()))


def importance_weights(cell: Cells, chosen: NDArray[np.int64]) -> NDArray[np.float64]:
    """Weight of each chosen row that would restore the share its cell had before, mean 1."""
    _, place, before = np.unique(cell, return_inverse=True, return_counts=True)
    after = np.bincount(place[chosen], minlength=len(before))
    weight = before[place[chosen]] / after[place[chosen]]
    normalised: NDArray[np.float64] = weight / weight.mean()
    return normalised


def effective_sample_size(weight: NDArray[np.float64]) -> float:
    """Kish's (sum w)^2 / sum w^2: how many rows of the original log the weighted choice is worth."""
    return float(weight.sum() ** 2 / (weight**2).sum()) if len(weight) else 0.0
