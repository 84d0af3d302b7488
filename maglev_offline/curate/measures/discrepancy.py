"""How far rows are from filling the state-action space evenly, without cells."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.grid import unit
from maglev_offline.streams import stream

Array = NDArray[np.float64]

MOST_ROWS = 2000
"""So many rows are measured, before as after: its time grows with the square of the rows, and its value depends on
their number, so that only sets of one size compare."""


class Discrepancies(NamedTuple):
    """Of all rows and of the chosen ones, and how many `rows` of each were drawn."""

    before: float
    after: float
    rows: int


def discrepancies(values: Array, chosen: NDArray[np.int64], edge_quantile: float, seed: int) -> Discrepancies:
    """Measure rows drawn from `values` [n, d], and from the `chosen` ones of them.

    Both in the unit box of all rows (`grid.unit`): by range and not by rank, since ranks are even by definition.
    """
    size = min(MOST_ROWS, len(chosen))
    # Two streams of one name: where all rows are chosen, both draws are the same one.
    before, after = (
        stream(seed, "curate: discrepancy rows").choice(n, size, replace=False) for n in (len(values), len(chosen))
    )
    rows = np.concatenate([before, chosen[after]])
    places = np.stack([unit(values[:, d], edge_quantile)[rows] for d in range(values.shape[1])], axis=1)
    return Discrepancies(centred_discrepancy(places[:size]), centred_discrepancy(places[size:]), size)


def centred_discrepancy(points: Array) -> float:
    """Square of the centred L2 discrepancy of points [n, d] in the unit box; 0 would be even, smaller is better.

    Hickernell, Mathematics of Computation 67 (1998), as scipy reckons it.
    """
    from scipy.stats import qmc  # scipy.stats takes half a second to import

    return float(qmc.discrepancy(points, method="CD"))
