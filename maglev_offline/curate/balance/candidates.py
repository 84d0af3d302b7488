"""What every balance chooses from: bare arrays, since tables of ten million rows are too dear to copy."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.grid import Cells

Array = NDArray[np.float64]


class Candidates(NamedTuple):
    """The n rows for training.

    `values` [n, 4]: gap error in m, gap velocity in m/s, current error in A, voltage deviation in V. `cost` [n].
    `cell` [n]: the equal-width cell of each row, in which every balance is measured, whatever it chose by.
    """

    values: Array
    cost: Array
    cell: Cells
