import numpy as np
import pytest
import torch

from maglev_offline import mdp as process
from maglev_offline.agents import networks
from maglev_offline.errors import ArtefactError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant
from maglev_offline.policies.policy import Policy, checked, from_metadata, metadata


def by_torch(net, plant, mdp, states):
    """The voltage as training and evaluation form it."""
    seen = process.observation(mdp, process.deviation(plant, State(*states)))
    act = networks.act(net, torch.from_numpy(seen.astype(np.float32)))[:, 0].numpy()
    return process.voltage(mdp, plant, act.astype(np.float64))


def test_it_is_the_network_of_the_training_with_scales_equilibrium_and_limit_inside(policy, net, states):
    expected = by_torch(net, policy.plant, policy.mdp, states)
    np.testing.assert_allclose(policy.voltage(*states), expected, atol=1e-5 * policy.mdp.voltage_limit_v)


def test_it_reaches_the_voltage_limit_and_never_passes_it(policy, states):
    v = policy.voltage(*states) - policy.plant.equilibrium().voltage_v
    assert v.max() > 0.9 * policy.mdp.voltage_limit_v
    assert v.min() < -0.9 * policy.mdp.voltage_limit_v
    assert np.abs(v).max() <= policy.mdp.voltage_limit_v * (1 + 1e-12)


def test_numbers_and_arrays_of_any_shape_go_in_and_broadcast(policy):
    assert policy.voltage(0.009, 0.0, 20.0).shape == ()
    grid = policy.voltage(np.linspace(0.004, 0.015, 6).reshape(2, 3), 0.0, 20.0)
    assert grid.shape == (2, 3)
    assert grid[1, 2] == pytest.approx(float(policy.voltage(0.015, 0.0, 20.0)), abs=1e-9)


def test_a_state_that_is_not_finite_gives_the_voltage_of_the_equilibrium(policy, not_finite):
    rest, usable = policy.plant.equilibrium().voltage_v, (0.009, 0.1, 20.0)
    voltage = policy.voltage(*(np.append(x, ok) for x, ok in zip(not_finite, usable, strict=True)))
    assert set(voltage[:-1]) == {rest}
    assert voltage[-1] == pytest.approx(float(policy.voltage(*usable)), abs=1e-9)
    assert voltage[-1] != rest


def test_what_it_says_about_itself_reads_back_exactly(policy):
    plant = Plant(mass_kg=700 / 3, set_point_m=0.0081)
    odd = Policy(policy.net, plant, Mdp(control_period_ms=5, voltage_limit_v=100 / 3), policy.origin)
    again = from_metadata(odd.net, metadata(odd), "here")
    assert (again.plant, again.mdp, again.origin) == (odd.plant, odd.mdp, odd.origin)
    told = metadata(odd)
    assert float(told["voltage_eq_v"]) == plant.equilibrium().voltage_v
    assert "gap_m in m" in told["inputs"]
    assert told["seed"] == "3"


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"format": "other"}, "no policy that this version reads"),
        ({"plant": "{"}, "cannot be read"),
        ({"mdp": '{"control_period_ms": -1}'}, "cannot be read"),
        ({"seed": "three"}, "cannot be read"),
    ],
)
def test_what_cannot_be_said_is_refused(policy, change, what):
    with pytest.raises(ArtefactError, match=what):
        from_metadata(policy.net, metadata(policy) | change, "here")


def test_a_network_that_is_no_actor_is_refused(policy):
    critic = {name: w.numpy() for name, w in networks.init_critic(np.random.default_rng(0), (8, 8)).items()}
    for net in (critic, {"w1": critic["w1"]}, {}):
        with pytest.raises(ArtefactError, match="not an actor"):
            checked(Policy(net, policy.plant, policy.mdp, policy.origin), "here")


def test_an_actor_that_has_diverged_is_refused(policy):
    net = {**policy.net, "w2": np.full_like(policy.net["w2"], np.nan)}
    with pytest.raises(ArtefactError, match="best actor of seed 3 has diverged"):
        checked(Policy(net, policy.plant, policy.mdp, policy.origin), "here")
