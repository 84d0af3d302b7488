"""Coarse cells of gap error, gap velocity and voltage, in which a map of the state space is drawn.

Logged states crowd about the set-point and have long tails. So cells lie evenly about zero and grow outwards
fourfold: one about zero, and three to each side, of which the outermost has no end.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]

FARTHEST_QUANTILE = 0.975
"""The outermost cells begin where this share of the rows lies inside."""

CELLS = 7
"""Cells along an axis."""


def inner_edges(values: Array) -> Array:
    """The six edges between the cells of an axis, ascending, in the unit of `values` [n]; (-h, -h/4, -h/16, ...).

    h is the quantile of the distance from zero. Where all values are zero the edges are too small to part anything.
    """
    farthest = max(float(np.quantile(np.abs(values), FARTHEST_QUANTILE)), np.finfo(np.float64).tiny * 16)
    above = farthest / np.array([16.0, 4.0, 1.0])
    return np.concatenate([-above[::-1], above])


def cells_along(values: Array, edges: Array) -> NDArray[np.int64]:
    """The cell of each value, from 0; shape [n]."""
    return np.searchsorted(edges, values, side="right").astype(np.int64)


class StateCells(NamedTuple):
    """The cell of each of n rows by gap error and gap velocity, and all cells there are.

    `gap`, `velocity` [n]: which cell along each axis; `places`: a row for each of the `CELLS` x `CELLS` cells in the
    order of `number`, with `gap_cell`, `velocity_cell` and where they begin and end (infinite outermost), in SI units.
    """

    gap: NDArray[np.int64]
    velocity: NDArray[np.int64]
    places: pd.DataFrame

    @property
    def number(self) -> NDArray[np.int64]:
        """Of each row, counted through all cells; shape [n]."""
        return self.gap * CELLS + self.velocity


def state_cells(gap_error_m: Array, velocity_m_s: Array) -> StateCells:
    """Cut the rows [n] into cells whose edges are theirs."""
    gap_edges, velocity_edges = inner_edges(gap_error_m), inner_edges(velocity_m_s)
    gap, velocity = (axis.ravel() for axis in np.meshgrid(np.arange(CELLS), np.arange(CELLS), indexing="ij"))
    places = pd.DataFrame({"gap_cell": gap.astype(np.int32), "velocity_cell": velocity.astype(np.int32)})
    places["gap_from_m"], places["gap_to_m"] = (edge[gap] for edge in ends(gap_edges))
    places["velocity_from_m_s"], places["velocity_to_m_s"] = (edge[velocity] for edge in ends(velocity_edges))
    return StateCells(cells_along(gap_error_m, gap_edges), cells_along(velocity_m_s, velocity_edges), places)


def ends(edges: Array) -> tuple[Array, Array]:
    """Where each cell begins and ends, both [CELLS]; the outermost ones at minus and plus infinity."""
    return np.append(-np.inf, edges), np.append(edges, np.inf)
