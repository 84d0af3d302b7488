import numpy as np
import pytest

from maglev_offline.curate.constructions.semi_markov import semi_markov_rows
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT = Plant()


def test_at_rest_the_cost_is_a_geometric_sum_of_decisions_and_the_discount_its_power(samples_of):
    mdp = Mdp(discount=0.9, cost_velocity_s2_per_m2=0, cost_voltage_per_v2=0)
    table = semi_markov_rows(pairs_of(samples_of([0.009, 0.009]), PLANT), PLANT, mdp)
    one_decision = 10 * 6000 * 0.001**2
    assert table["cost"][0] == pytest.approx(one_decision * (1 - 0.9**10) / (1 - 0.9))
    assert table["discount"][0] == pytest.approx(0.9**10)
    assert table["duration_s"][0] == pytest.approx(0.1)


def test_the_logged_voltage_is_paid_for_over_the_whole_duration(samples_of):
    mdp = Mdp(discount=0.5, cost_gap_per_m2=0, cost_velocity_s2_per_m2=0, cost_voltage_per_v2=2.0)
    rest = PLANT.equilibrium().voltage_v
    table = semi_markov_rows(pairs_of(samples_of([0.008] * 2, voltage_v=[rest + 3, rest]), PLANT), PLANT, mdp)
    assert table["cost"][0] == pytest.approx(10 * 2 * 9 * (1 - 0.5**10) / 0.5)


def test_a_duration_of_no_whole_number_of_control_periods_has_a_power_between(samples_of):
    mdp = Mdp(control_period_ms=40, discount=0.8, episode_duration_s=0.4)
    table = semi_markov_rows(pairs_of(samples_of([0.009, 0.009]), PLANT), PLANT, mdp)
    assert table["discount"][0] == pytest.approx(0.8**2.5)


def test_pairs_of_one_control_period_are_one_decision_each(samples_of):
    mdp = Mdp(control_period_ms=100, discount=0.8, cost_velocity_s2_per_m2=0, cost_voltage_per_v2=0)
    table = semi_markov_rows(pairs_of(samples_of([0.009, 0.009]), PLANT), PLANT, mdp)
    assert table["discount"][0] == pytest.approx(0.8)
    assert table["cost"][0] == pytest.approx(100 * 6000 * 0.001**2)


def test_on_a_small_grid_the_cost_is_that_of_the_true_motion(samples_every):
    """Two decisions a pair, against the 1 kHz truth: sum of gamma^k times the cost of each."""
    mdp = Mdp(cost_voltage_per_v2=0)
    truth = samples_every(1)
    z1, z2 = truth["gap_m"] - truth["set_point_m"], truth["gap_velocity_m_s"]
    stage = (mdp.cost_gap_per_m2 * z1**2 + mdp.cost_velocity_s2_per_m2 * z2**2).to_numpy()
    key = ["point", "segment", "t"]
    later = truth[key].assign(true=np.convolve(stage, np.r_[np.full(10, 0.9), np.full(10, 1.0)])[19:][: len(truth)])
    table = semi_markov_rows(pairs_of(samples_every(20), PLANT), PLANT, mdp).merge(later, on=key)
    steady = ~table["truncated"]  # the set-point steps in some segments: a row keeps its own
    error = np.abs(table["cost"] - table["true"])[steady]
    assert np.median(error / table["true"][steady]) < 0.01
