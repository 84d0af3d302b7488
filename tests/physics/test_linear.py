"""Linearisation: the paper's matrices to their printed digits, and the Jacobian of the nonlinear model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.physics.dynamics import State, derivative
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant


def test_matrices_as_printed_in_the_paper() -> None:
    linear = linearise(Plant())
    np.testing.assert_allclose(linear.a, [[0, 1, 0], [2450, 0, -1.1558], [0, 2119.7, -3.1438]], atol=0.05, rtol=0)
    assert linear.a[1, 2] == pytest.approx(-1.1558, abs=5e-5)
    assert linear.a[2, 2] == pytest.approx(-3.1438, abs=5e-5)
    np.testing.assert_allclose(linear.b.ravel(), [0, 0, 2.6198], atol=5e-5)
    np.testing.assert_array_equal(linear.c, [[1, 0, 0]])


def test_poles() -> None:
    np.testing.assert_allclose(linearise(Plant()).poles, [18.754, -10.949 + 17.053j, -10.949 - 17.053j], atol=6e-4)


plants = st.builds(
    lambda mass, ohm, slope, offset, pole, gap: Plant(
        mass_kg=mass,
        resistance_ohm=ohm,
        inductance_slope_h_m=slope,
        inductance_offset_h=offset,
        pole_offset_m=pole,
        set_point_m=gap,
        gap_max_m=0.02,
    ),
    st.floats(0.01, 1e4),
    st.floats(0.1, 10),
    st.floats(1e-4, 1e-2),
    st.floats(0, 0.5),
    st.floats(0, 0.01),
    st.floats(0.002, 0.015),
)


@settings(max_examples=50, deadline=None)
@given(plants)
def test_equals_numerical_jacobian(plant: Plant) -> None:
    point, linear = plant.equilibrium(), linearise(plant)
    rest = np.array([point.gap_m, 0.0, point.current_a, point.voltage_v])
    scale = np.array([point.gap_m, 0.1, point.current_a, point.voltage_v])

    def rate(x: np.ndarray) -> np.ndarray:
        return np.array(derivative(plant, State(*x[:3]), x[3]))

    for column, step in enumerate(1e-6 * scale):
        h = np.eye(4)[column] * step
        slope = (rate(rest + h) - rate(rest - h)) / (2 * step)
        exact = np.concatenate([linear.a, linear.b], axis=1)[:, column]
        np.testing.assert_allclose(slope * scale[column], exact * scale[column], rtol=1e-6, atol=1e-6)
