"""Equal shares for cells: `cells`, of equal width, and `quantiles`, cut at the quantiles of each axis."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.candidates import Candidates
from maglev_offline.curate.balance.grid import bins_of, quantile_cells
from maglev_offline.curate.balance.quota import balanced_choice
from maglev_offline.curate.settings import CurateSettings


def cells(candidates: Candidates, settings: CurateSettings, rng: np.random.Generator) -> NDArray[np.int64]:
    """Equal shares for cells of equal width: rare states and voltages weigh as much as common ones."""
    return balanced_choice(candidates.cell, settings.target_rows, rng)


def quantiles(candidates: Candidates, settings: CurateSettings, rng: np.random.Generator) -> NDArray[np.int64]:
    """Equal shares for cells that are small where rows are many: keeps more of the common ones than `cells`."""
    cell = quantile_cells(candidates.values, bins_of(settings))
    return balanced_choice(cell, settings.target_rows, rng)
