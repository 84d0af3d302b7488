"""The diagnostic by cell of the state space: where rows teach the truth, and where they do not.

The numbers are those of `diagnostic`, of the rows of one cell alone: the spread of the advantage is that of the cell,
so the question is whether two actions can be told apart there.
"""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.curate.cells import CELLS, StateCells, state_cells
from maglev_offline.curate.diagnostic import Judged, statistics, sums_by_unit, verdict_of
from maglev_offline.curate.resampling import LEAST_ROWS, LEAST_UNITS, interval_of_part, rows_and_units

Array = NDArray[np.float64]

TOO_FEW = "too_few"
"""Stands for the verdict on a cell with fewer than `LEAST_ROWS` rows or `LEAST_UNITS` units; it has no numbers."""

_NUMBERS = ("error_over_advantage_std", "correlation_with_advantage")


def judged_rows(judged: Judged) -> pd.DataFrame:
    """Each row that was judged: where it lies, its cell, and both advantages.

    Columns: `log_id`, `point`, `segment`, `step`, `substep`, `gap_cell`, `velocity_cell`, `advantage` (the true one,
    y* - V(s)) and `taught_advantage` (y - V(s)), both in units of cost, and `weight`: how many rows it stands for.
    """
    rows = judged.rows[["log_id", "point", "segment", "step", "substep"]].reset_index(drop=True)
    cells = _cells(judged)
    rows["gap_cell"], rows["velocity_cell"] = cells.gap.astype(np.int32), cells.velocity.astype(np.int32)
    rows["advantage"] = judged.targets.advantage
    rows["taught_advantage"] = judged.targets.taught - judged.targets.value
    rows["weight"] = judged.weight
    return rows


def diagnostic_cells(judged: Judged) -> pd.DataFrame:
    """Both numbers with intervals, and a verdict, for each of the `CELLS` x `CELLS` cells of gap error and velocity.

    Columns: `gap_cell`, `velocity_cell`, where they begin and end (`gap_from_m`, `gap_to_m`, `velocity_from_m_s`,
    `velocity_to_m_s`; infinite outermost), `rows`, `units`, both numbers each with `..._low` and `..._high` (NaN
    where there are too few rows, or nothing varies), `verdict`. The resamples are those of the diagnostic of all rows.
    """
    state = _cells(judged)
    cell = state.number
    cells, units = CELLS**2, judged.counts.shape[1]
    sums = sums_by_unit(judged.targets, judged.unit * cells + cell, units * cells, judged.weight).reshape(
        units, cells, -1
    )
    points = statistics(sums.sum(axis=0))
    drawn = statistics(np.tensordot(judged.counts.astype(np.float64), sums, axes=1))
    count, of_units = rows_and_units(cell, judged.unit, cells)
    enough = (count >= LEAST_ROWS) & (of_units >= LEAST_UNITS)
    table = state.places.assign(rows=count, units=of_units)
    between = [[interval_of_part(one[:, k]) if enough[k] else None for k in range(cells)] for one in drawn]
    for name, point, spans in zip(_NUMBERS, points, between, strict=True):
        table[name] = np.where(enough, point, np.nan)
        table[[f"{name}_low", f"{name}_high"]] = [(np.nan, np.nan) if span is None else span for span in spans]
    verdicts = [verdict_of(*spans) for spans in zip(*between, strict=True)]
    table["verdict"] = np.where(enough, np.array(verdicts), TOO_FEW)
    return table


def _cells(judged: Judged) -> StateCells:
    gap, velocity = (judged.rows[name].to_numpy(dtype=np.float64) for name in ("gap_error_m", "gap_velocity_m_s"))
    return state_cells(gap, velocity)
