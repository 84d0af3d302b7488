import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from maglev_offline.control.lqi import held_model
from maglev_offline.curate.reference_value import reference_policy, value
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()


def value_of(state, mdp=MDP, plant=PLANT):
    return value(plant, mdp, reference_policy(plant, mdp), np.atleast_2d(state))


def test_near_the_set_point_it_is_the_quadratic_form_of_the_discounted_riccati_equation():
    a, b, w = held_model(PLANT, MDP)
    root = np.sqrt(MDP.discount)
    p = solve_discrete_are(root * a, root * b, w[:3, :3], w[3:, 3:], s=w[:3, 3:])
    small = np.random.default_rng(0).normal(0, MDP.state_scale * 1e-3, (20, 3))
    np.testing.assert_allclose(value_of(small), np.einsum("ni,ij,nj->n", small, p, small), rtol=0.02)


def test_standing_at_the_set_point_costs_nothing():
    assert value_of([0.0, 0.0, 0.0])[0] == pytest.approx(0, abs=1e-20)


def test_what_is_cut_off_is_the_share_that_is_promised():
    """From a stop, without a way back, every decision costs the same: the geometric series says what is left out."""
    lost = np.array([[PLANT.gap_max_m - PLANT.set_point_m, 0.0, -PLANT.equilibrium().current_a]])
    weak = Mdp(voltage_limit_v=1e-3, cost_velocity_s2_per_m2=0, cost_voltage_per_v2=1e-12)
    stage = weak.plant_steps_per_decision * weak.cost_gap_per_m2 * lost[0, 0] ** 2
    assert value_of(lost, weak)[0] == pytest.approx(stage / (1 - weak.discount), rel=2e-5)


def test_nothing_is_paid_after_an_end_in_contact():
    falling = [[PLANT.gap_max_m - PLANT.set_point_m - 1e-4, 0.3, -10.0]]
    ends, goes_on = (Mdp(terminate_on_contact=end, contact_penalty=5.0) for end in (True, False))
    once = value_of(falling, ends)[0]
    assert 5 < once < 10
    assert value_of(falling, goes_on)[0] > once + 5
