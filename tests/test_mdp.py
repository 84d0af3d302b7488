"""The decision process: one cost, one scaling, and times that fit."""

import numpy as np
import pytest
from pydantic import ValidationError

from maglev_offline import mdp as process
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant


def test_cost_as_in_the_paper() -> None:
    z, v = np.array([[0.007, 0.1, 5.0], [0.0, 0.0, 9.0]]), np.array([200.0, 0.0])
    np.testing.assert_allclose(process.stage_cost(Mdp(), z, v), [6000 * 0.007**2 + 0.1**2 + 7.5e-8 * 200**2, 0.0])
    np.testing.assert_allclose(process.row_cost(Mdp(), z, v), 10 * process.stage_cost(Mdp(), z, v))


def test_times() -> None:
    mdp = Mdp(control_period_ms=5)
    assert (mdp.plant_steps_per_decision, mdp.decisions_per_episode, mdp.plant_step_s) == (5, 100, 0.001)


@pytest.mark.parametrize(
    "wrong",
    [
        {"control_period_ms": 1.5},
        {"control_period_ms": 0.5},
        {"control_period_ms": 7},
        {"start_gap_m": (0.01, 0.004)},
        {"discount": 1.0},
    ],
)
def test_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Mdp.model_validate(wrong)


def test_deviation_at_a_moved_set_point() -> None:
    plant = Plant()
    moved = plant.equilibrium(0.009)
    state = State(np.array([0.009]), np.array([0.0]), np.array([moved.current_a]))
    np.testing.assert_allclose(process.deviation(plant, state, 0.009), 0.0, atol=1e-15)
    assert process.deviation(plant, state)[0, 0] == pytest.approx(0.001)


def test_action_and_voltage_are_inverse() -> None:
    plant, mdp = Plant(), Mdp()
    act = np.linspace(-1, 1, 7)
    u = process.voltage(mdp, plant, act)
    np.testing.assert_allclose(process.action(mdp, u - plant.equilibrium().voltage_v), act, atol=1e-15)


def test_observation_and_contact() -> None:
    np.testing.assert_allclose(process.observation(Mdp(), np.array([0.0025, 0.075, 3.75])), 1.0)
    np.testing.assert_array_equal(process.contact(Plant(), np.array([0.0005, 0.008, 0.016])), [True, False, True])


@pytest.mark.parametrize("times", [{"episode_duration_s": 1e308}, {"plant_step_ms": 1e-300}])
def test_times_that_no_number_of_steps_fits_are_refused(times):
    with pytest.raises(ValidationError, match="must"):
        Mdp(**times)
