"""How evenly rows lie over cells."""

from typing import NamedTuple

import numpy as np

from maglev_offline.curate.balance.grid import Cells, narrow


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
    share = np.unique(narrow(cell), return_counts=True)[1] / len(cell)
    return Occupancy(len(cell), len(share), float(-(share * np.log(share)).sum()), float(1 / (share**2).sum()))
