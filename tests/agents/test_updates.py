"""One gradient step of DDPG and of TD3, against the formulas of the paper's Algorithms 1 and 2 written out per seed."""

import numpy as np
import pytest
import torch

from maglev_offline.agents import networks
from maglev_offline.agents.ddpg import Ddpg
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.agents.td3 import Td3
from maglev_offline.replay.buffer import Batch

SEEDS, ROWS = [0, 1, 2], 12


@pytest.fixture
def settings() -> TrainingSettings:
    """The paper's algorithms: nothing that this project adds."""
    return TrainingSettings(
        hidden=(6, 5),
        actor_last_layer_scale=1.0,
        smoothing_std=2.0,
        smoothing_clip=0.5,
        layer_norm_critic=False,
        critic_root_offset=0.0,
        saturation_weight=0.0,
    )


@pytest.fixture
def batch() -> Batch:
    rng = np.random.default_rng(0)
    seeds = len(SEEDS)

    def normal(width: int) -> torch.Tensor:
        return torch.tensor(rng.normal(size=(seeds, ROWS, width)), dtype=torch.float32)

    discount = torch.where(torch.rand(seeds, ROWS, 1, generator=torch.Generator().manual_seed(0)) < 0.3, 0.0, 0.9)
    return Batch(normal(3), normal(1).clamp(-1, 1), normal(1).abs(), normal(3), discount)


@pytest.fixture
def noise() -> torch.Tensor:
    return torch.randn(len(SEEDS), ROWS, 1, generator=torch.Generator().manual_seed(5))


def seed_of(net, seed, critic=None):
    picked = {
        name: (value[critic] if critic is not None else value)[seed].detach().clone() for name, value in net.items()
    }
    return {name: value.requires_grad_() for name, value in picked.items()}


def adam_step(net, loss, rate):
    """The first step of Adam: rate * g / (|g| + eps), since both moments are corrected for their start."""
    gradients = torch.autograd.grad(loss, list(net.values()))
    return {
        name: value.detach() - rate * g / (g.abs() + 1e-8)
        for (name, value), g in zip(net.items(), gradients, strict=True)
    }


def close(stacked, seed, expected, critic=None):
    for name, value in expected.items():
        actual = (stacked[name][critic] if critic is not None else stacked[name])[seed].detach()
        torch.testing.assert_close(actual, value, atol=2e-6, rtol=1e-4)


def rows_of(batch, seed):
    return Batch(*(field[seed] for field in batch[:5]))


def test_ddpg_is_algorithm_1(settings, batch, noise):
    agent = Ddpg(SEEDS, settings)
    start = [(seed_of(agent.actor, s), seed_of(agent.critic, s, 0)) for s in range(len(SEEDS))]
    agent.update(batch, noise, step=1)
    for seed, (actor, critic) in enumerate(start):
        one = rows_of(batch, seed)
        target = one.cost + one.discount * networks.value(
            critic, one.next_observation, networks.act(actor, one.next_observation)
        )
        error = networks.value(critic, one.observation, one.action) - target.detach()
        new_critic = adam_step(critic, (error**2).mean(), settings.critic_learning_rate)
        cost_to_go = networks.value(new_critic, one.observation, networks.act(actor, one.observation)).mean()
        new_actor = adam_step(actor, cost_to_go, settings.actor_learning_rate)
        close(agent.critic, seed, new_critic, critic=0)
        close(agent.actor, seed, new_actor)
        tau = settings.target_rate
        close(agent.slow_actor, seed, {k: (1 - tau) * actor[k].detach() + tau * v for k, v in new_actor.items()})


def test_td3_is_algorithm_2_with_the_larger_of_two_costs(settings, batch, noise):
    agent = Td3(SEEDS, settings)
    start = [
        (seed_of(agent.actor, s), seed_of(agent.critic, s, 0), seed_of(agent.critic, s, 1)) for s in range(len(SEEDS))
    ]
    agent.update(batch, noise, step=2)
    for seed, (actor, first, second) in enumerate(start):
        one = rows_of(batch, seed)
        smoothing = (noise[seed] * settings.smoothing_std).clamp(-0.5, 0.5)
        next_action = (networks.act(actor, one.next_observation) + smoothing).clamp(-1, 1)
        values = [networks.value(critic, one.next_observation, next_action) for critic in (first, second)]
        target = (one.cost + one.discount * torch.maximum(*values)).detach()
        updated = []
        for number, critic in enumerate((first, second)):
            error = networks.value(critic, one.observation, one.action) - target
            updated.append(adam_step(critic, (error**2).mean(), settings.critic_learning_rate))
            close(agent.critic, seed, updated[number], critic=number)
        cost_to_go = networks.value(updated[0], one.observation, networks.act(actor, one.observation)).mean()
        close(agent.actor, seed, adam_step(actor, cost_to_go, settings.actor_learning_rate))


def test_td3_moves_its_actor_and_slow_copies_every_second_step_only(settings, batch, noise):
    agent = Td3(SEEDS, settings)
    actor, slow = networks.copy(agent.actor), networks.copy(agent.slow_critic)
    agent.update(batch, noise, step=1)
    assert all(torch.equal(agent.actor[name], actor[name]) for name in actor)
    assert all(torch.equal(agent.slow_critic[name], slow[name]) for name in slow)
    agent.update(batch, noise, step=2)
    assert not torch.equal(agent.actor["w1"], actor["w1"])
    assert not torch.equal(agent.slow_critic["w1"], slow["w1"])


@pytest.mark.parametrize("algorithm", [Ddpg, Td3])
def test_no_seed_touches_another(algorithm, settings, batch, noise):
    plain, spoiled = algorithm(SEEDS, settings), algorithm(SEEDS, settings)
    other = Batch(*(field.clone() for field in batch[:5]))
    other.cost[1] += 100.0
    plain.update(batch, noise, step=2)
    spoiled.update(other, noise, step=2)
    for name, value in plain.critic.items():
        assert torch.equal(value[:, [0, 2]], spoiled.critic[name][:, [0, 2]])
    assert not torch.equal(plain.critic["w1"][:, 1], spoiled.critic["w1"][:, 1])


@pytest.mark.parametrize("algorithm", [Ddpg, Td3])
def test_a_seed_that_diverges_stays_alone(algorithm, settings, batch, noise):
    agent = algorithm(SEEDS, settings)
    batch.cost[1, 0] = float("nan")
    agent.update(batch, noise, step=2)
    assert torch.isnan(agent.critic["w1"][:, 1]).any()
    assert torch.isfinite(agent.critic["w1"][:, [0, 2]]).all()
    assert torch.isfinite(agent.actor["w1"][[0, 2]]).all()


@pytest.mark.parametrize("algorithm", [Ddpg, Td3])
def test_an_ended_episode_is_worth_its_cost_and_a_time_out_bootstraps(algorithm, settings, batch, noise):
    """With discount 0 the next state must not matter; with gamma it must."""
    for discount, same in ((0.0, True), (0.9, False)):
        results = []
        for shift in (0.0, 5.0):
            agent = algorithm(SEEDS, settings)
            moved = batch._replace(
                discount=torch.full_like(batch.discount, discount), next_observation=batch.next_observation + shift
            )
            agent.update(moved, noise, step=1)
            results.append(agent.critic["w1"].detach().clone())
        assert torch.equal(*results) is same


def test_batch_norm_in_the_actor_learns_too(settings, batch, noise):
    agent = Td3(SEEDS, settings.model_copy(update={"batch_norm_actor": True}))
    before = networks.copy(agent.actor)
    agent.update(batch, noise, step=2)
    assert not torch.equal(agent.actor["gain_1"], before["gain_1"])
    assert not torch.equal(agent.actor["mean_1"], before["mean_1"])


@pytest.mark.parametrize("algorithm", [Ddpg, Td3])
def test_cloning_pulls_the_actor_to_the_actions_of_prefilled_rows_alone(algorithm, settings, batch, noise):
    """Normalised cost-to-go plus the weighted squared distance, over the whole batch."""
    weight = 2.5
    agent = algorithm(SEEDS, settings.model_copy(update={"cloning_weight": weight}))
    prefilled = torch.zeros(len(SEEDS), ROWS, 1)
    prefilled[:, :5] = 1.0
    start = [seed_of(agent.actor, s) for s in range(len(SEEDS))]
    agent.update(batch._replace(prefilled=prefilled), noise, step=2)
    for seed, actor in enumerate(start):
        one, critic = rows_of(batch, seed), seed_of(agent.critic, seed, 0)  # the actor goes down the updated critic
        policy = networks.act(actor, one.observation)
        value = networks.value(critic, one.observation, policy)
        away = (policy - one.action)[:5].square().sum() / ROWS
        loss = value.mean() / value.detach().abs().mean() + weight * away
        close(agent.actor, seed, adam_step(actor, loss, settings.actor_learning_rate))


@pytest.mark.parametrize("algorithm", [Ddpg, Td3])
def test_without_a_weight_the_logged_actions_do_not_matter(algorithm, settings, batch, noise):
    plain, other = algorithm(SEEDS, settings), algorithm(SEEDS, settings)
    plain.update(batch, noise, step=2)
    other.update(batch._replace(prefilled=torch.ones(len(SEEDS), ROWS, 1)), noise, step=2)
    assert all(torch.equal(value, other.actor[name]) for name, value in plain.actor.items())


@pytest.mark.parametrize("algorithm", [Ddpg, Td3])
def test_layer_norm_in_the_critics_learns_too(algorithm, settings, batch, noise):
    agent = algorithm(SEEDS, settings.model_copy(update={"layer_norm_critic": True}))
    before = networks.copy(agent.critic)
    agent.update(batch, noise, step=2)
    for name in ("gain_1", "shift_1", "gain_2", "shift_2"):
        assert not torch.equal(agent.critic[name], before[name])
        assert not torch.equal(agent.slow_critic[name], before[name])


@pytest.mark.parametrize("algorithm", [Ddpg, Td3])
def test_critics_of_roots_learn_the_root_of_the_target(algorithm, settings, batch, noise):
    """Equations (1) and (2) with h(q) = sqrt(q + e) - sqrt(e) for costs-to-go that are not negative."""
    offset, rate = 0.04, settings.critic_learning_rate
    agent = algorithm(SEEDS, settings.model_copy(update={"critic_root_offset": offset, "smoothing_std": 0.0}))
    critics = agent.critic["w3"].shape[0]
    start = [(seed_of(agent.actor, s), [seed_of(agent.critic, s, k) for k in range(critics)]) for s in range(3)]
    agent.update(batch, noise, step=2)
    for seed, (actor, of_seed) in enumerate(start):
        one = rows_of(batch, seed)
        action = networks.act(actor, one.next_observation)
        roots = torch.stack([networks.value(critic, one.next_observation, action) for critic in of_seed]).amax(0)
        cost_to_go = roots.sign() * ((roots.abs() + offset**0.5) ** 2 - offset)
        total = one.cost + one.discount * cost_to_go
        target = (total.sign() * ((total.abs() + offset).sqrt() - offset**0.5)).detach()
        for number, critic in enumerate(of_seed):
            error = networks.value(critic, one.observation, one.action) - target
            close(agent.critic, seed, adam_step(critic, (error**2).mean(), rate), critic=number)


@pytest.mark.parametrize("algorithm", [Ddpg, Td3])
def test_an_actor_that_saturates_everywhere_is_pulled_back(algorithm, settings, batch, noise):
    """tanh is 1 in single precision, and has no slope left: without the pull nothing would ever move the actor."""
    for weight, moves in ((0.0, False), (0.1, True)):
        agent = algorithm(SEEDS, settings.model_copy(update={"saturation_weight": weight}))
        with torch.no_grad():
            agent.actor["b3"].fill_(30.0)
        agent.update(batch, noise, step=2)
        after = agent.actor["b3"].detach()
        assert bool((after < 30.0).all()) == moves
