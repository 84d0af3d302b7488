import numpy as np
import pytest

from maglev_offline.agents.divergence import BEYOND, diverged, largest_value
from maglev_offline.agents.torch_engine import TorchLearner

GAPS = np.array([0.006, 0.015])


@pytest.fixture
def nets(world):
    learner = TorchLearner("td3", [0, 1, 2], world.plant, world.mdp, world.training)
    return learner.actors(), learner.critics()


def found(nets, world):
    return diverged(*nets, world.plant, world.mdp, GAPS, 0.0).tolist()


def test_fresh_networks_have_not_diverged(nets, world):
    assert found(nets, world) == [False, False, False]


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_weight_that_is_no_number_is_seen_at_its_own_seed(nets, world, kind, value):
    nets[kind]["w2"][..., 1, 0, 0] = value
    assert found(nets, world) == [False, True, False]


@pytest.mark.parametrize("critic", [0, 1])
@pytest.mark.parametrize(("times", "is_beyond"), [(0.9 * BEYOND, False), (1.1 * BEYOND, True)])
def test_a_critic_that_explodes_is_seen_before_it_is_no_number(nets, world, critic, times, is_beyond):
    nets[1]["w3"][critic, 2] = 0.0
    nets[1]["b3"][critic, 2] = -times * largest_value(world.plant, world.mdp)
    assert found(nets, world) == [False, False, is_beyond]


def test_the_largest_value_is_that_of_resting_at_the_farther_stop(world):
    mdp = world.mdp.model_copy(update={"contact_penalty": 2.0})
    stage = 6000 * 0.008**2 + 7.5e-8 * 200**2
    assert largest_value(world.plant, mdp) == pytest.approx((10 * stage + 2.0) / 0.1)


def test_critics_of_roots_are_held_to_the_cost_to_go_that_they_stand_for(nets, world):
    nets[1]["w3"][0, 2] = 0.0
    nets[1]["b3"][0, 2] = (2 * BEYOND * largest_value(world.plant, world.mdp)) ** 0.5
    assert found(nets, world) == [False, False, False]
    assert diverged(*nets, world.plant, world.mdp, GAPS, 0.01).tolist() == [False, False, True]
