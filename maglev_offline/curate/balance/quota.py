"""Equal shares for cells, as far as they are filled."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.grid import Cells, narrow


def balanced_choice(cell: Cells, target: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Choose `target` rows so that no cell gives more than another could have given too.

    Every cell gives min(its rows, quota) rows at random; the quota is the largest that does not exceed the target,
    and the remainder comes from cells drawn at random. Returns sorted row numbers; all rows if there are too few.
    """
    n = len(cell)
    if n <= target:
        return np.arange(n)
    shuffled = np.empty(n, dtype=np.int64)
    shuffled[rng.permutation(n)] = np.arange(n)
    kept = narrow(cell)[shuffled]
    order = np.argsort(kept, kind="stable")
    kept, order = kept[order], shuffled[order]  # by cell, and at random within it
    start = np.flatnonzero(np.append(True, kept[1:] != kept[:-1]))
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
