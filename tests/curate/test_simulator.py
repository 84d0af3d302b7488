import numpy as np
import pytest

from maglev_offline.curate.simulator import hold
from maglev_offline.env import SuspensionBatch
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
def test_it_is_the_environment_that_agents_train_in_stops_and_penalty_included(any_plant, integrator):
    mdp = Mdp(integrator=integrator, contact_penalty=2.5, voltage_limit_v=200)
    rng = np.random.default_rng(3)
    rest = any_plant.equilibrium()
    batch = SuspensionBatch(any_plant, mdp, 60)
    gap = rng.uniform(any_plant.gap_min_m, any_plant.gap_max_m, 60)
    batch.state = State(gap, rng.normal(0, 0.2, 60), rest.current_a * rng.uniform(0, 2, 60))
    state, act = batch.deviation(), rng.uniform(-1, 1, 60)
    _, cost, touched = batch.step(act)
    held = hold(any_plant, mdp, state, mdp.voltage_limit_v * act)
    np.testing.assert_allclose(held.next_state, batch.deviation(), atol=1e-12)
    np.testing.assert_allclose(held.cost, cost, rtol=1e-9)
    np.testing.assert_array_equal(held.touched, touched)
    assert touched.any()
    assert not touched.all()


def test_a_voltage_may_be_held_for_another_time(any_plant):
    mdp = Mdp()
    state, voltage = np.array([[0.0005, 0.01, 0.1]]), np.array([1.0])
    once = hold(any_plant, mdp, state, voltage)
    twice = hold(any_plant, mdp, once.next_state, voltage)
    long = hold(any_plant, mdp, state, voltage, 2 * mdp.plant_steps_per_decision)
    np.testing.assert_allclose(long.next_state, twice.next_state, rtol=1e-9)
    np.testing.assert_allclose(long.cost, once.cost + twice.cost, rtol=1e-9)
