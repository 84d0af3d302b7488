"""Cells of the state-action space: of equal width, or with equally many rows along each axis."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.settings import CurateSettings

Array = NDArray[np.float64]
Cells = NDArray[np.int64]


def bins_of(settings: CurateSettings) -> tuple[int, ...]:
    """Number of cells along each axis of `Candidates.values`."""
    return settings.bins_gap, settings.bins_velocity, settings.bins_current, settings.bins_voltage


def unit(column: Array, edge_quantile: float) -> Array:
    """Place [n] of each value between two quantiles of its column, in [0, 1].

    Values beyond them count as at the edge, so that single outliers stretch nothing.
    """
    low, high = np.quantile(column, [edge_quantile, 1 - edge_quantile])
    place: Array = column - low
    place /= high - low if high > low else 1.0
    return np.clip(place, 0.0, 1.0, out=place)


def cells_of(values: Array, bins: tuple[int, ...], edge_quantile: float) -> Cells:
    """Number of the cell of each row of `values` [n, d]: each axis is cut into equal intervals of `unit`."""
    cell = np.zeros(len(values), dtype=np.int64)
    for d, n in enumerate(bins):
        place = unit(values[:, d], edge_quantile)
        place *= n
        cell *= n
        cell += np.minimum(place.astype(np.int64), n - 1)
    return cell


def quantile_cells(values: Array, bins: tuple[int, ...]) -> Cells:
    """Number of the cell of each row of `values` [n, d]: each axis is cut at its own quantiles.

    Each interval of an axis has as many rows as the others, but where equal values would have to be parted: an axis
    that stands still is one interval.
    """
    cell = np.zeros(len(values), dtype=np.int64)
    for d, n in enumerate(bins):
        column = np.ascontiguousarray(values[:, d])
        edges = np.unique(np.quantile(column, np.arange(1, n) / n, method="inverted_cdf"))
        cell *= n
        cell += np.searchsorted(edges, column, side="left")
    return cell


def narrow(cell: Cells) -> NDArray[np.integer]:
    """The same numbers in the smallest type, since sorting small integers is many times as fast."""
    return cell.astype(np.min_scalar_type(cell.max(initial=0)), copy=False)


def rows_in_cell(cell: Cells) -> NDArray[np.int64]:
    """How many rows share the cell of each row, shape [n]."""
    _, place, count = np.unique(narrow(cell), return_inverse=True, return_counts=True)
    shared: NDArray[np.int64] = count[place]
    return shared
