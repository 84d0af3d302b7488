"""Metrics on responses that can be worked out by hand."""

import numpy as np
import pytest

from maglev_offline.control import metrics
from maglev_offline.control.simulate import Trajectory
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

TIME = np.arange(1001) / 1000
DECAY = np.exp(-10 * TIME)[:, None] * np.array([0.005, -0.003])


def test_settling_of_a_decay() -> None:
    np.testing.assert_allclose(metrics.settling_time_s(TIME, DECAY), np.log(50) / 10, atol=1e-3)


def test_must_stay_inside_to_the_end() -> None:
    late, never = DECAY[:, :1].copy(), DECAY[:, :1].copy()
    late[800], never[-1] = 0.004, 0.004
    assert metrics.settling_time_s(TIME, late)[0] == pytest.approx(0.801)
    assert np.isnan(metrics.settling_time_s(TIME, never)[0])


def test_start_at_the_set_point() -> None:
    still = np.zeros((1001, 1))
    assert metrics.settling_time_s(TIME, still)[0] == 0
    assert np.isnan(metrics.overshoot(still)[0])


def test_overshoot_is_on_the_other_side() -> None:
    error = np.array([[1.0, -1.0, 1.0], [2.0, 0.3, 0.5], [-0.25, -3.0, 0.1]])
    np.testing.assert_allclose(metrics.overshoot(error), [0.25, 0.3, 0.0])


def test_bias_and_rmse() -> None:
    error = np.r_[np.full(80, 3.0), np.full(20, 0.5)][:, None]
    assert metrics.steady_state_bias_m(error)[0] == 0.5
    assert metrics.gap_rmse_m(error)[0] == pytest.approx(np.sqrt((80 * 9 + 20 * 0.25) / 100))


def test_all_of_a_response() -> None:
    plant, mdp = Plant(), Mdp()
    _, i_eq, u_eq = plant.equilibrium()
    gap = np.full((1001, 1), 0.008)
    gap[:100] = 0.016
    v = np.zeros((1000, 1))
    v[:50], v[900] = 200.0, -300.0
    response = Trajectory(TIME, gap, gap * 0, gap * 0 + i_eq, u_eq + v)
    found = {name: value.item() for name, value in metrics.response_metrics(plant, mdp, response).items()}
    assert found["cost"] == pytest.approx(100 * 6000 * 0.008**2 + 50 * 7.5e-8 * 200**2)
    assert found["settling_time_s"] == pytest.approx(0.1)
    assert found["peak_voltage_v"] == pytest.approx(300)
    assert found["saturation_fraction"] == pytest.approx(0.1)
    assert found["contact_fraction"] == pytest.approx(100 / 501)
    assert found["overshoot"] == 0
