"""Draws in which rows have weights: `none`, `inverse_density` and `low_cost`."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.candidates import Candidates
from maglev_offline.curate.balance.draw import weighted_draw
from maglev_offline.curate.balance.grid import cells_of, rows_in_cell
from maglev_offline.curate.settings import CurateSettings

DENSITY_BINS = 20
"""Intervals of each axis of the histogram that stands for the density: half as wide as the default cells."""


def none(candidates: Candidates, settings: CurateSettings, rng: np.random.Generator) -> NDArray[np.int64]:
    """No balance: rows drawn with equal weights, so that they lie as the log does."""
    n = len(candidates.cost)
    return np.sort(rng.choice(n, min(n, settings.target_rows), replace=False))


def inverse_density(candidates: Candidates, settings: CurateSettings, rng: np.random.Generator) -> NDArray[np.int64]:
    """Weight 1 / density, by a histogram of `DENSITY_BINS` equal intervals an axis between the edge quantiles."""
    fine = cells_of(candidates.values, (DENSITY_BINS,) * candidates.values.shape[1], settings.edge_quantile)
    return weighted_draw(1 / rows_in_cell(fine), settings.target_rows, rng)


def low_cost(candidates: Candidates, settings: CurateSettings, rng: np.random.Generator) -> NDArray[np.int64]:
    """Weight 1 / (rows in the cell) times c_low / (c_low + cost), where c_low is the `low_cost_quantile` of the costs.

    The emphasis on rows of low cost of the paper's Sec. V, which names no formula. Within a cell a row without cost is
    twice as likely as one of cost c_low; between cells the cheap ones give more.
    """
    low = max(float(np.quantile(candidates.cost, settings.low_cost_quantile)), np.finfo(np.float64).tiny)
    weight = low / (low + np.maximum(candidates.cost, 0.0))
    weight /= rows_in_cell(candidates.cell)
    return weighted_draw(np.maximum(weight, np.finfo(np.float64).tiny), settings.target_rows, rng)
