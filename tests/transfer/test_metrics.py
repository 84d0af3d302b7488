import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.transfer.metrics import area, asymptote, drift, jumpstart, time_to_threshold

STEPS = np.array([0, 10, 20, 40])
COST = np.array([[8.0, 4.0, 2.0, 2.0], [8.0, 8.0, 8.0, 0.0]])

curves = st.lists(st.floats(0, 100), min_size=8, max_size=8).map(lambda c: np.array(c).reshape(2, 4))


def test_jumpstart_is_the_mean_of_the_first_evaluations():
    np.testing.assert_allclose(jumpstart(COST, 1), [8, 8])
    np.testing.assert_allclose(jumpstart(COST, 3), [14 / 3, 8])


def test_asymptote_is_the_mean_of_the_last_evaluations():
    np.testing.assert_allclose(asymptote(COST, 1), [2, 0])
    np.testing.assert_allclose(asymptote(COST, 3), [8 / 3, 16 / 3])


def test_area_is_the_mean_height_on_the_real_step_axis():
    # Trapezia by hand: (6 x 10 + 3 x 10 + 2 x 20) / 40 and (8 x 10 + 8 x 10 + 4 x 20) / 40.
    np.testing.assert_allclose(area(STEPS, COST), [130 / 40, 240 / 40])


def test_a_single_evaluation_is_its_own_area():
    np.testing.assert_array_equal(area(STEPS[:1], COST[:, :1]), [8, 8])


def test_drift_is_the_change_of_the_fitted_line_over_the_window():
    line = np.array([5.0 + 0.25 * STEPS, 5.0 - 0.5 * STEPS])
    np.testing.assert_allclose(drift(STEPS, line, 4), [10, -20])
    np.testing.assert_allclose(drift(STEPS, line, 2), [5, -10])
    # Least squares by hand: x = (-40, -10, 50) / 3, y = (4, 2, 2): slope -240 / 4200 = -2 / 35, over 30 steps.
    np.testing.assert_allclose(drift(STEPS, COST, 3)[0], 30 * -2 / 35)
    np.testing.assert_array_equal(drift(STEPS, COST, 1), [0, 0])


@pytest.mark.parametrize(
    ("costs", "hold", "steps", "reached"),
    [
        ([8, 4, 2, 2], 1, 10, True),
        ([8, 4, 2, 2], 2, 10, True),
        ([8, 4, 9, 2], 1, 10, True),  # once is enough where nothing has to hold
        ([8, 4, 9, 2], 2, 40, False),  # it does not hold
        ([8, 9, 4, 2], 2, 20, True),
        ([8, 9, 9, 2], 2, 40, False),  # the run ends before it could have held
        ([3, 4, 4, 4], 4, 0, True),
        ([9, 9, 9, 9], 1, 40, False),
    ],
)
def test_the_threshold_must_hold_and_a_run_that_never_gets_there_is_censored(costs, hold, steps, reached):
    found = time_to_threshold(STEPS, np.array([costs], dtype=float), 4.0, hold)
    assert found.steps.tolist() == [steps]
    assert found.reached.tolist() == [reached]


def test_a_run_that_gets_there_at_the_end_is_not_one_that_never_does():
    found = time_to_threshold(STEPS, np.array([[9.0, 9, 9, 1], [9, 9, 9, 9]]), 4.0, 1)
    assert found.steps.tolist() == [40, 40]
    assert found.reached.tolist() == [True, False]


def test_a_cost_that_is_no_number_never_reaches_the_threshold():
    assert not time_to_threshold(STEPS, np.array([[np.nan, np.nan, 1, np.nan]]), 4.0, 2).reached[0]


@given(curves, st.floats(0.1, 50), st.integers(1, 4))
def test_a_planted_difference_comes_back_from_every_mean(cost, planted, window):
    for metric in (lambda c: jumpstart(c, window), lambda c: asymptote(c, window), lambda c: area(STEPS, c)):
        np.testing.assert_allclose(metric(cost + planted) - metric(cost), planted, atol=1e-9)
    np.testing.assert_allclose(drift(STEPS, cost + planted, window), drift(STEPS, cost, window), atol=1e-9)


@given(curves, st.floats(0, 100), st.integers(1, 4))
def test_a_worse_curve_never_reaches_the_threshold_sooner(cost, threshold, hold):
    better, worse = (time_to_threshold(STEPS, c, threshold, hold) for c in (cost, cost + 1.0))
    assert (worse.steps >= better.steps).all()
    assert (worse.reached <= better.reached).all()


@given(curves, st.permutations([0, 1]))
def test_every_seed_has_its_own_number(cost, order):
    for metric in (lambda c: jumpstart(c, 2), lambda c: asymptote(c, 2), lambda c: area(STEPS, c),
                   lambda c: drift(STEPS, c, 3), lambda c: time_to_threshold(STEPS, c, 50.0, 2).steps):  # fmt: skip
        np.testing.assert_allclose(metric(cost[order]), metric(cost)[order], atol=1e-9)
