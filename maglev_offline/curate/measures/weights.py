"""What a choice of rows is worth, when weighted back to what it was chosen from."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.grid import Cells, narrow


def importance_weights(cell: Cells, chosen: NDArray[np.int64]) -> NDArray[np.float64]:
    """Weight of each chosen row that would restore the share its cell had before, mean 1.

    A cell of which nothing was chosen cannot be restored: the shares are among the others then.
    """
    _, place, before = np.unique(narrow(cell), return_inverse=True, return_counts=True)
    after = np.bincount(place[chosen], minlength=len(before))
    weight = before[place[chosen]] / after[place[chosen]]
    normalised: NDArray[np.float64] = weight / weight.mean()
    return normalised


def effective_sample_size(weight: NDArray[np.float64]) -> float:
    """Kish's (sum w)^2 / sum w^2: how many rows of the original log the weighted choice is worth."""
    return float(weight.sum() ** 2 / (weight**2).sum()) if len(weight) else 0.0
