"""The extended Kalman filter: its Jacobian, and that the gap alone serves the LQI."""

import numpy as np

from maglev_offline.control.lqi import LqiWeights, lqi
from maglev_offline.control.metrics import settling_time_s
from maglev_offline.control.observer import ObserverFeedback, ObserverSettings, jacobian
from maglev_offline.control.simulate import regulate
from maglev_offline.mdp import Mdp, deviation
from maglev_offline.physics.dynamics import State, derivative, step
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()
FILTER = ObserverFeedback(PLANT, lqi(PLANT, LqiWeights(), 200.0), ObserverSettings())


def test_jacobian_at_rest_is_the_linearisation(any_plant: Plant) -> None:
    gap, current, voltage = any_plant.equilibrium()
    found = jacobian(any_plant, State(gap, 0.0, current), voltage)
    np.testing.assert_allclose(found, linearise(any_plant).a, rtol=1e-9, atol=1e-9)


def test_jacobian_away_from_rest_is_numerical(any_plant: Plant) -> None:
    x, volts, tiny = np.array([0.006, -0.2, 25.0]), np.array(150.0), 1e-7
    exact = jacobian(any_plant, State(*x), volts)
    for k in range(3):
        h = np.eye(3)[k] * tiny
        ahead, behind = (np.array(derivative(any_plant, State(*(x + w * h)), volts)) for w in (1, -1))
        np.testing.assert_allclose((ahead - behind) / (2 * tiny), exact[:, k], rtol=1e-5, atol=1e-3)


def test_sees_the_gap_only() -> None:
    """Velocity and current of z change nothing."""
    z = np.array([[0.003, 0.0, 0.0]])
    memory = FILTER.start(z)
    v, _ = FILTER.control(z, memory, 1e-3)
    other, _ = FILTER.control(z + np.array([0.0, 1.0, 5.0]), memory, 1e-3)
    np.testing.assert_array_equal(v, other)


def test_settles_from_the_gap_alone_and_learns_a_wrong_current() -> None:
    start = np.array([0.015, 0.006, 0.010])
    response = regulate(PLANT, MDP, FILTER, start, 1.0)
    assert np.all(settling_time_s(response.time_s, response.gap_m - 0.008) < 0.2)
    z = np.array([[0.001, 0.0, 0.0]])
    memory = FILTER.start(z)
    wrong = memory._replace(state=memory.state._replace(current_a=memory.state.current_a + 2.0))
    state = State(np.array([0.009]), np.zeros(1), np.array([PLANT.equilibrium().current_a]))
    for _ in range(200):
        v, wrong = FILTER.control(deviation(PLANT, state), wrong, 1e-3)
        state = step(PLANT, state, PLANT.equilibrium().voltage_v + v, 1e-3, integrator="rk4")
    assert abs(wrong.state.current_a - state.current_a)[0] < 0.1
    eigenvalues = np.linalg.eigvalsh(wrong.covariance)
    assert np.all(eigenvalues > 0)
