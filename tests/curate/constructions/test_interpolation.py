import numpy as np
import pytest

from maglev_offline.curate.constructions.interpolation import state_between, voltage_between
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.physics.parameters import Plant

PLANT = Plant()
REST = PLANT.equilibrium()
HALF_WAY = np.array([0.05])
ONE = np.array([0])


def pair(samples_of, gap, velocity, origin="measured"):
    samples = samples_of(gap, velocity_m_s=velocity, current_a=[18, 22], voltage_v=[20, 40])
    return pairs_of(samples.assign(gap_velocity_origin=origin), PLANT)


def test_half_way_the_cubic_is_where_hermite_has_it(samples_of):
    """(x0 + x1) / 2 + T (w0 - w1) / 8, with the slope 3 (x1 - x0) / (2 T) - (w0 + w1) / 4."""
    found = state_between(pair(samples_of, [0.007, 0.009], [0.03, -0.01]), ONE, HALF_WAY)[0]
    assert found[0] == pytest.approx(0.0 + 0.1 * 0.04 / 8)
    assert found[1] == pytest.approx(1.5 * 0.002 / 0.1 - 0.02 / 4)
    assert found[2] == pytest.approx(20 - REST.current_a)


def test_a_motion_that_is_a_cubic_comes_back_exactly(samples_of):
    def gap(t):
        return 0.007 + 0.02 * t - 0.3 * t**2 + 2 * t**3

    def velocity(t):
        return 0.02 - 0.6 * t + 6 * t**2

    pairs = pair(samples_of, [gap(0), gap(0.1)], [velocity(0), velocity(0.1)])
    t = np.linspace(0, 0.1, 21)
    found = state_between(pairs, np.zeros(21, dtype=int), t)
    np.testing.assert_allclose(found[:, 0] + 0.008, gap(t), atol=1e-15)
    np.testing.assert_allclose(found[:, 1], velocity(t), atol=1e-15)


def test_without_a_logged_velocity_gap_and_velocity_are_linear(samples_of):
    found = state_between(pair(samples_of, [0.007, 0.010], [0.03, -0.01], "reconstructed"), ONE, np.array([0.025]))[0]
    assert found[0] == pytest.approx(-0.001 + 0.003 / 4)
    assert found[1] == pytest.approx(0.02)


def test_the_ends_are_the_samples_and_the_voltage_is_a_line(samples_of):
    pairs = pair(samples_of, [0.007, 0.009], [0.03, -0.01])
    np.testing.assert_allclose(state_between(pairs, ONE, np.array([0.0])), pairs.state, atol=1e-15)
    np.testing.assert_allclose(state_between(pairs, ONE, np.array([0.1])), pairs.next_state, atol=1e-15)
    assert voltage_between(pairs, ONE, np.array([0.025]))[0] == pytest.approx(25 - REST.voltage_v)
