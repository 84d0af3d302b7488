import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.consistency import inconsistent, one_step_residual
from maglev_offline.curate.constructions.rows import NEXT_STATE, STATE
from maglev_offline.curate.simulator import hold
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()


def test_rows_of_the_simulator_have_no_residual(simulator_rows):
    np.testing.assert_allclose(one_step_residual(simulator_rows(50), PLANT, MDP), 0, atol=1e-12)


def test_a_residual_is_measured_in_state_scales(simulator_rows):
    table = simulator_rows(3)
    table.loc[0, "next_gap_error_m"] += 2 * MDP.gap_scale_m
    table.loc[1, "next_current_error_a"] -= 3 * MDP.current_scale_a
    table.loc[2, ["next_gap_error_m", "next_gap_velocity_m_s"]] += [3 * MDP.gap_scale_m, 4 * MDP.velocity_scale_m_s]
    np.testing.assert_allclose(one_step_residual(table, PLANT, MDP), [2, 3, 5], rtol=1e-9)


@pytest.mark.parametrize(("origin", "periods"), [("semi_markov", 3), ("interpolated", 3), ("raw", 1)])
def test_the_voltage_is_held_for_as_long_as_the_row_says(simulator_rows, origin, periods):
    """A raw row says that of one decision, however long it took."""
    table = simulator_rows(10).assign(origin=origin, duration_s=0.03)
    state, voltage = table[list(STATE)].to_numpy(), table["voltage_deviation_v"].to_numpy()
    there = hold(PLANT, MDP, state, voltage, periods * MDP.plant_steps_per_decision).next_state
    table = table.assign(**dict(zip(NEXT_STATE, there.T, strict=True)))
    np.testing.assert_allclose(one_step_residual(table, PLANT, MDP), 0, atol=1e-12)


def test_durations_may_differ(simulator_rows):
    table = pd.concat([simulator_rows(4), simulator_rows(4).assign(duration_s=0.05)], ignore_index=True)
    residual = one_step_residual(table, PLANT, MDP)
    np.testing.assert_allclose(residual[:4], 0, atol=1e-12)
    assert (residual[4:] > 0.01).all()


@pytest.mark.parametrize(
    ("fraction", "kept"), [(1.0, [0, 1, 2, 3]), (0.5, [1, 3]), (0.25, [1]), (0.01, [1]), (0.75, [0, 1, 3])]
)
def test_the_share_that_agrees_best_is_kept_and_one_row_at_least(fraction, kept):
    marked = inconsistent(np.array([2.0, 0.0, 2.0, 1.0]), fraction)
    assert np.flatnonzero(~marked).tolist() == kept
