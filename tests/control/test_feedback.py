"""Feedback with integral: signs, anti-windup, poles."""

import numpy as np

from maglev_offline.control.feedback import IntegralFeedback, closed_loop_poles, is_stable
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

Z = np.array([[0.002, 0.0, 0.0], [0.1, 0.0, 0.0]])


def test_integral_holds_while_the_voltage_saturates() -> None:
    law = IntegralFeedback(np.array([3100.0, 310.0, 0.0, 300.0]), voltage_limit_v=200.0)
    v, memory = law.control(Z, law.start(Z), 0.01)
    np.testing.assert_allclose(v, [6.2, 200.0])
    np.testing.assert_allclose(memory, [2e-5, 0.0])


def test_without_a_limit_nothing_holds() -> None:
    law = IntegralFeedback(np.array([3100.0, 310.0, 0.0, 300.0]))
    v, memory = law.control(Z, np.array([0.5, 0.5]), 0.01)
    np.testing.assert_allclose(v, [156.2, 460.0])
    np.testing.assert_allclose(memory, [0.50002, 0.501])


def test_gain_of_each_magnet() -> None:
    law = IntegralFeedback(np.array([[1.0, 0, 0, 0], [2.0, 0, 0, 0]]))
    np.testing.assert_allclose(law.control(Z, law.start(Z), 0.01)[0], [0.002, 0.2])


def test_without_feedback_the_poles_are_the_plants() -> None:
    linear = linearise(Plant())
    np.testing.assert_allclose(
        np.sort_complex(closed_loop_poles(linear, np.zeros(4))), np.sort_complex(linear.poles), rtol=1e-9
    )
    assert not is_stable(linear.poles)
