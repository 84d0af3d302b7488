"""By cell the diagnostic says where rows teach the truth, and does not say it where there are too few."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.cells import CELLS
from maglev_offline.curate.diagnostic import diagnosis_of, judge
from maglev_offline.curate.diagnostic_cells import TOO_FEW, diagnostic_cells, judged_rows
from maglev_offline.curate.resampling import LEAST_ROWS, LEAST_UNITS
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()


@pytest.fixture(scope="module")
def judged(simulator_rows):
    """Rows of the simulator, but those with a larger gap than the set-point lie about their costs."""
    table = simulator_rows(2000)
    above = (table["gap_error_m"] > 0).to_numpy()
    table["cost"] += np.where(above, np.random.default_rng(0).normal(0, 20, len(table)), 0)
    return judge(table, PLANT, MDP, 0)


@pytest.fixture(scope="module")
def cells(judged):
    return diagnostic_cells(judged)


def test_rows_that_lie_in_one_region_are_found_there_and_nowhere_else(cells):
    known = cells[cells["verdict"] != TOO_FEW]
    above, below = known[known["gap_cell"] > CELLS // 2], known[known["gap_cell"] < CELLS // 2]
    assert len(above) > 5
    assert (above["verdict"] == "harmful").all()
    assert len(below) > 5
    assert (below["verdict"] == "fit").all()
    assert (below["error_over_advantage_std"] < 1e-9).all()


def test_a_cell_has_the_numbers_of_its_rows_alone(judged, cells):
    rows = judged_rows(judged)
    cell = cells[cells["verdict"] == "harmful"].iloc[0]
    mine = rows[(rows["gap_cell"] == cell["gap_cell"]) & (rows["velocity_cell"] == cell["velocity_cell"])]
    error = np.sqrt(np.mean((mine["taught_advantage"] - mine["advantage"]) ** 2)) / mine["advantage"].std(ddof=0)
    assert cell["rows"] == len(mine)
    assert cell["error_over_advantage_std"] == pytest.approx(error, rel=1e-6)
    correlation = np.corrcoef(mine["taught_advantage"], mine["advantage"])[0, 1]
    assert cell["correlation_with_advantage"] == pytest.approx(correlation, abs=1e-6)
    for name in ("error_over_advantage_std", "correlation_with_advantage"):
        assert cell[f"{name}_low"] < cell[name] < cell[f"{name}_high"]


def test_every_row_that_was_judged_is_in_one_cell(judged, cells):
    assert cells["rows"].sum() == diagnosis_of(judged).rows == len(judged_rows(judged))
    assert len(cells) == CELLS**2
    assert not judged_rows(judged).duplicated(["log_id", "point", "segment", "step", "substep"]).any()


def test_a_cell_with_too_few_rows_or_units_has_no_numbers(cells, simulator_rows):
    few = cells[(cells["rows"] < LEAST_ROWS) | (cells["units"] < LEAST_UNITS)]
    assert len(few) > 0
    assert (few["verdict"] == TOO_FEW).all()
    numbers = [name for name in cells if "advantage" in name]
    assert few[numbers].isna().all(axis=None)
    one_stretch = diagnostic_cells(judge(simulator_rows(15), PLANT, MDP, 0))
    assert (one_stretch["verdict"] == TOO_FEW).all()


def test_the_same_rows_give_the_same_table(judged, cells):
    pd.testing.assert_frame_equal(diagnostic_cells(judged), cells)
