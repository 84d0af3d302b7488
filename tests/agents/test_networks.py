import numpy as np
import pytest
import torch

from maglev_offline.agents import networks
from maglev_offline.streams import stream


def actor(seed=0, *, batch_norm=False, hidden=(6, 5)):
    return networks.init_actor(stream(seed, "actor weights"), hidden, 1.0, batch_norm)


def critic(seed=0, hidden=(6, 5)):
    return networks.init_critic(stream(seed, "critic 0 weights"), hidden)


def reference_actor(net):
    """The same network from torch's own layers."""
    layers = [torch.nn.Linear(3, 6), torch.nn.Linear(6, 5), torch.nn.Linear(5, 1)]
    for number, layer in enumerate(layers, start=1):
        layer.weight.data = net[f"w{number}"].T
        layer.bias.data = net[f"b{number}"][0]
    return torch.nn.Sequential(layers[0], torch.nn.ReLU(), layers[1], torch.nn.ReLU(), layers[2], torch.nn.Tanh())


def test_the_actor_is_two_hidden_layers_of_relu_and_a_tanh():
    net, seen = actor(), torch.randn(7, 3, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(networks.act(net, seen), reference_actor(net)(seen))


def test_the_action_enters_the_critic_at_its_second_layer():
    net = critic()
    seen, act = torch.tensor([[0.1, -0.2, 0.3]]), torch.tensor([[0.7]])
    first = torch.relu(seen @ net["w1"] + net["b1"])
    second = torch.relu(torch.cat((first, act), 1) @ net["w2"] + net["b2"])
    torch.testing.assert_close(networks.value(net, seen, act), second @ net["w3"] + net["b3"])
    assert net["w1"].shape == (3, 6)
    assert net["w2"].shape == (7, 5)


@pytest.mark.parametrize("batch_norm", [False, True])
def test_a_seed_in_a_stack_computes_what_it_computes_alone(batch_norm):
    nets = [actor(seed, batch_norm=batch_norm) for seed in range(3)]
    seen = torch.randn(3, 4, 3, generator=torch.Generator().manual_seed(2))
    together = networks.act(networks.stack(nets), seen)
    for seed, net in enumerate(nets):
        torch.testing.assert_close(together[seed], networks.act(net, seen[seed]))


def test_batch_norm_layers_have_no_bias_and_normalise_each_feature_over_the_batch():
    net = actor(batch_norm=True)
    assert "b1" not in net
    assert "b2" not in net
    seen = torch.randn(64, 3, generator=torch.Generator().manual_seed(3))
    h = networks._normalised(net, 1, seen @ net["w1"], training=True)
    torch.testing.assert_close(h.mean(0), torch.zeros(6), atol=1e-6, rtol=0)
    torch.testing.assert_close(h.var(0, unbiased=False), torch.ones(6), atol=1e-3, rtol=0)


def test_running_statistics_follow_as_in_torch():
    net = actor(batch_norm=True)
    layer = torch.nn.BatchNorm1d(6)
    generator = torch.Generator().manual_seed(4)
    for _ in range(3):
        h = torch.randn(32, 6, generator=generator)
        layer(h)
        networks._normalised(net, 1, h, training=True)
    torch.testing.assert_close(net["mean_1"][0], layer.running_mean)
    torch.testing.assert_close(net["var_1"][0], layer.running_var)


def test_acting_uses_the_running_statistics_and_does_not_move_them():
    net = actor(batch_norm=True)
    before = networks.copy(net)
    networks.act(net, torch.randn(5, 3))
    assert all(torch.equal(net[name], before[name]) for name in net)


def test_no_gradient_moves_a_running_statistic():
    net = networks.trained(networks.stack([actor(batch_norm=True)]), "cpu")
    assert {name for name, value in net.items() if not value.requires_grad} == set(networks.STATISTICS)


def test_the_slow_copy_goes_a_share_of_the_way():
    slow, net = {"w": torch.tensor([1.0, 2.0])}, {"w": torch.tensor([3.0, 6.0])}
    networks.track(slow, net, 0.25)
    torch.testing.assert_close(slow["w"], torch.tensor([1.5, 3.0]))


def test_initial_weights_lie_within_one_over_the_root_of_the_fan_in():
    net = networks.init_actor(stream(0, "actor weights"), (40, 40), 0.05, False)
    assert net["w2"].abs().max() <= 1 / np.sqrt(40)
    assert net["w3"].abs().max() <= 0.05 / np.sqrt(40)


def test_layer_norm_normalises_the_features_of_a_critics_row_before_the_relu():
    net = networks.init_critic(stream(0, "critic 0 weights"), (6, 5), layer_norm=True)
    generator = torch.Generator().manual_seed(6)
    for layer, width in ((1, 6), (2, 5)):
        net[f"gain_{layer}"] = torch.randn(1, width, generator=generator)
        net[f"shift_{layer}"] = torch.randn(1, width, generator=generator)
    seen, act = torch.randn(4, 3, generator=generator), torch.randn(4, 1, generator=generator)

    def normed(layer, h):
        return torch.nn.functional.layer_norm(h, h.shape[-1:], net[f"gain_{layer}"][0], net[f"shift_{layer}"][0], 1e-5)

    first = torch.relu(normed(1, seen @ net["w1"] + net["b1"]))
    second = torch.relu(normed(2, torch.cat((first, act), 1) @ net["w2"] + net["b2"]))
    torch.testing.assert_close(networks.value(net, seen, act), second @ net["w3"] + net["b3"])


def test_layer_norm_starts_from_the_weights_of_a_critic_without_it():
    with_norm = networks.init_critic(stream(0, "critic 0 weights"), (6, 5), layer_norm=True)
    assert all(torch.equal(value, with_norm[name]) for name, value in critic().items())


def test_one_of_several_networks_shares_their_memory_and_takes_no_gradient():
    net = networks.trained(networks.stack([critic(0), critic(1)]), "cpu")
    one = networks.member(net, 1)
    assert not one["w1"].requires_grad
    with torch.no_grad():
        net["w1"][1] += 1
    assert torch.equal(one["w1"], net["w1"][1])
