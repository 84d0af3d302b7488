"""Which rows are kept: a pure function for each balance, by the name a recipe gives it."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.by_cells import cells, quantiles
from maglev_offline.curate.balance.by_weight import inverse_density, low_cost, none
from maglev_offline.curate.balance.candidates import Candidates as Candidates
from maglev_offline.curate.balance.k_centre import coverage
from maglev_offline.curate.settings import BalanceName, CurateSettings
from maglev_offline.streams import stream

Balance = Callable[[Candidates, CurateSettings, np.random.Generator], NDArray[np.int64]]
"""To the sorted numbers of `target_rows` different rows, or of all rows where there are too few."""

BALANCES: dict[BalanceName, Balance] = {
    "cells": cells,
    "quantiles": quantiles,
    "inverse_density": inverse_density,
    "coverage": coverage,
    "low_cost": low_cost,
    "none": none,
}


def choose(candidates: Candidates, settings: CurateSettings) -> NDArray[np.int64]:
    """Choose rows as the recipe says; the same rows, settings and seed give the same choice."""
    return BALANCES[settings.balance](candidates, settings, stream(settings.seed, "curate: balance"))
