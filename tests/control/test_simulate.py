"""Closing the loop: the environment's own steps, holding, and plants without stops."""

import numpy as np

from maglev_offline.control.feedback import IntegralFeedback
from maglev_offline.control.metrics import cost
from maglev_offline.control.simulate import FARTHEST, regulate
from maglev_offline.env import SuspensionBatch
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()
LAW = IntegralFeedback(np.array([2e5, 3e3, -50.0, 0.0]), 200.0)


def test_costs_what_the_environment_says() -> None:
    starts = np.array([0.005, 0.012])
    response = regulate(PLANT, MDP, LAW, starts, 0.5, control_period_s=0.01)
    batch, total = SuspensionBatch(PLANT, MDP, 2), np.zeros(2)
    batch.reset(starts)
    for _ in range(50):
        v, _ = LAW.control(batch.deviation(), np.zeros(2), 0.01)
        total += batch.step(v / MDP.voltage_limit_v)[1]
    np.testing.assert_allclose(cost(PLANT, MDP, response), total, rtol=1e-12)
    np.testing.assert_allclose(response.gap_m[-1], batch.state.gap_m, rtol=1e-12)


def test_voltage_is_held_and_limited() -> None:
    response = regulate(PLANT, MDP, LAW, np.array([0.015]), 0.1, control_period_s=0.01)
    v = response.voltage_v[:, 0].reshape(10, 10) - PLANT.equilibrium().voltage_v
    assert np.all(v == v[:, :1])
    assert np.abs(v).max() <= 200 + 1e-9


def test_linear_plant_is_the_limit_of_small_deviations() -> None:
    start = np.array([PLANT.set_point_m + 1e-7])
    for integrator in ("euler", "rk4"):
        both = [
            regulate(PLANT, MDP, LAW, start, 0.2, plant_kind=kind, integrator=integrator)  # type: ignore[arg-type]
            for kind in ("linear", "nonlinear")
        ]
        np.testing.assert_allclose(both[0].gap_m, both[1].gap_m, atol=1e-11)


def test_unstable_loops_stay_finite() -> None:
    wild = IntegralFeedback(np.array([-1e6, 0.0, 0.0, 0.0]))
    linear = regulate(PLANT, MDP, wild, np.array([0.015]), 5.0, plant_kind="linear", limited=False)
    assert np.abs(linear.gap_m).max() <= FARTHEST + 1
    assert np.isfinite(cost(PLANT, MDP, linear)).all()
    nonlinear = regulate(PLANT, MDP, wild, np.array([0.015]), 1.0)
    assert nonlinear.gap_m[-1, 0] == PLANT.gap_max_m


def test_a_part_of_a_response() -> None:
    response = regulate(PLANT, MDP, LAW, np.array([0.015, 0.01]), 0.2)
    part = response.until(0.05)
    assert part.gap_m.shape == (51, 2)
    assert part.voltage_v.shape == (50, 2)
    assert response.until(9.0).gap_m.shape == response.gap_m.shape
