import numpy as np
import pytest

from maglev_offline.curate.constructions.interpolated import interpolated_rows
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.transitions import unusable
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()


def test_a_pair_gives_a_row_for_each_control_period_that_begin_where_the_last_one_ended(samples_of):
    table = interpolated_rows(pairs_of(samples_of([0.007, 0.009, 0.008], velocity_m_s=0.02), PLANT), PLANT, MDP)
    assert len(table) == 20
    np.testing.assert_allclose(table["next_gap_error_m"][:-1], table["gap_error_m"][1:], atol=1e-15)
    np.testing.assert_allclose(table["duration_s"], 0.01)
    np.testing.assert_array_equal(table["discount"], MDP.discount)
    assert table["substep"].tolist() == [*range(10), *range(10)]
    assert table["step"].tolist() == [0] * 10 + [1] * 10
    np.testing.assert_allclose((table["t"] - table["t"][0]).dt.total_seconds(), np.arange(20) * 0.01)
    assert table["truncated"].tolist() == [False] * 19 + [True]


def test_the_voltage_is_that_at_the_beginning_of_the_row(samples_of):
    table = interpolated_rows(pairs_of(samples_of([0.008] * 2, voltage_v=[20, 30]), PLANT), PLANT, MDP)
    np.testing.assert_allclose(table["voltage_deviation_v"] + PLANT.equilibrium().voltage_v, 20 + np.arange(10))


def test_the_cost_is_summed_over_the_plant_steps_of_the_row(samples_of):
    mdp = Mdp(cost_velocity_s2_per_m2=0, cost_voltage_per_v2=0)
    samples = samples_of([0.008, 0.009]).assign(gap_velocity_origin="reconstructed")
    table = interpolated_rows(pairs_of(samples, PLANT), PLANT, mdp)
    error_m = np.arange(100) * 1e-5
    np.testing.assert_allclose(table["cost"], (6000 * error_m**2).reshape(10, 10).sum(axis=1), rtol=1e-9)


def test_what_is_left_after_the_whole_control_periods_gives_no_row(samples_of):
    mdp = Mdp(control_period_ms=40, episode_duration_s=0.4)
    samples = samples_of([0.012, 0.016], contact=[False, True]).assign(gap_velocity_origin="reconstructed")
    table = interpolated_rows(pairs_of(samples, PLANT), PLANT, mdp.model_copy(update={"contact_penalty": 3.0}))
    assert len(table) == 2
    np.testing.assert_allclose(table["next_gap_error_m"], [0.004 + 0.4 * 0.004, 0.004 + 0.8 * 0.004])
    free = interpolated_rows(pairs_of(samples, PLANT), PLANT, mdp)
    np.testing.assert_allclose(table["cost"], free["cost"])  # the contact is in what is left


def test_a_pair_shorter_than_a_decision_is_not_usable(samples_of):
    mdp = Mdp(control_period_ms=200, episode_duration_s=1)
    table = interpolated_rows(pairs_of(samples_of([0.008, 0.009]), PLANT), PLANT, mdp)
    assert unusable(table, mdp).tolist() == ["shorter_than_a_decision"]


def test_samples_as_far_apart_as_decisions_are_kept_as_they_are(samples_every):
    pairs = pairs_of(samples_every(10), PLANT)
    table = interpolated_rows(pairs, PLANT, MDP)
    assert len(table) == len(pairs)
    np.testing.assert_allclose(table["next_gap_error_m"], pairs.next_state[:, 0], atol=1e-15)
    np.testing.assert_array_equal(table["voltage_deviation_v"], pairs.voltage_v)


@pytest.mark.parametrize(("period_ms", "within_m"), [(20, 3e-6), (50, 1e-4)])
def test_on_a_small_grid_the_states_are_those_of_the_true_motion(samples_every, period_ms, within_m):
    key = ["point", "segment", "t"]
    truth = samples_every(1)[[*key, "gap_m"]]
    table = interpolated_rows(pairs_of(samples_every(period_ms), PLANT), PLANT, MDP)
    between = table[table["substep"] > 0].merge(truth, on=key)
    pair = samples_every(period_ms)[["point", "segment", "step", "set_point_m"]]
    between = between.merge(pair, on=["point", "segment", "step"])
    assert len(between) == (table["substep"] > 0).sum() > 500
    error = between["gap_error_m"] + between["set_point_m"] - between["gap_m"]
    assert np.sqrt((error**2).mean()) < within_m
