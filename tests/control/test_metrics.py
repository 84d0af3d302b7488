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


def test_an_error_that_crosses_the_band_as_the_response_ends_has_not_settled() -> None:
    crossing = np.linspace(1, 0, 1001)[:, None]  # within 2 % for the last 20 ms
    assert np.isnan(metrics.settling_time_s(TIME, crossing)[0])


@pytest.mark.parametrize(("inside", "settled"), [(metrics.SETTLED_FOR_S + 0.001, True), (0.049, False)])
def test_settling_needs_50_ms_in_the_band(inside: float, settled: bool) -> None:
    error = np.where(1 - inside > TIME, 1.0, 0.0)[:, None]
    found = metrics.settling_time_s(TIME, error)[0]
    assert found == pytest.approx(1 - inside, abs=1.5e-3) if settled else np.isnan(found)


def test_a_limit_cycle_is_not_hidden_by_its_mean() -> None:
    swing = 0.002 * np.sin(2 * np.pi * 50 * TIME)[:, None]
    assert abs(metrics.steady_state_bias_m(swing)[0]) < 1e-9
    assert metrics.steady_state_error_m(swing)[0] == pytest.approx(0.002, rel=1e-9)


def test_the_steady_state_error_is_of_the_last_fifth_and_of_either_sign() -> None:
    error = np.r_[np.full(80, 3.0), np.full(19, 0.5), -0.7][:, None] * [1, -1]
    np.testing.assert_allclose(metrics.steady_state_error_m(error), [0.7, 0.7])


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
    assert found["steady_state_error_m"] == 0
    assert found["overshoot"] == 0
