import numpy as np
import pytest

from maglev_offline.agents.torch_engine import TorchLearner
from maglev_offline.replay.buffer import WIDTH

EVERYTHING = {
    "n_step": 3,
    "mixing_share": 0.4,
    "prefill_decay_steps": 150,
    "layer_norm_critic": True,
    "cloning_weight": 0.5,
    "batch_norm_actor": True,
    "buffer_capacity": 100,
}


def learner(world, seeds=(0, 1, 2), prefill=None, algorithm="td3", mdp=None, **changes):
    settings = world.training.model_copy(update=changes)
    return TorchLearner(algorithm, list(seeds), world.plant, mdp or world.mdp, settings, prefill)


def same(one, two):
    assert one.keys() == two.keys()
    for name, value in one.items():
        np.testing.assert_array_equal(value, two[name], err_msg=name)


def test_any_split_into_calls_gives_the_same_bits(world):
    whole, split = learner(world), learner(world)
    whole.advance(120)
    for steps in (7, 60, 53):
        split.advance(steps)
    same(whole.state(), split.state())


@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
@pytest.mark.parametrize("changes", [{}, EVERYTHING], ids=["plain", "everything"])
@pytest.mark.parametrize("at", [0, 30, 61, 110])
def test_what_was_restored_goes_on_in_the_same_bits(world, prefilled_rows, algorithm, changes, at):
    mdp = world.mdp.model_copy(update={"force_noise_std_n": 200.0, "terminate_on_contact": True})
    unbroken, stopped, resumed = (
        learner(world, prefill=prefilled_rows, algorithm=algorithm, mdp=mdp, **changes) for _ in range(3)
    )
    unbroken.advance(120)
    stopped.advance(at)
    resumed.restore(stopped.state(), stopped.new_rows())
    resumed.advance(120 - at)
    same(unbroken.state(), resumed.state())
    np.testing.assert_array_equal(unbroken.buffer.rows, resumed.buffer.rows)


def test_a_state_holds_no_memory_of_the_learner(world):
    one = learner(world)
    one.advance(80)
    state = one.state()
    kept = {name: value.copy() for name, value in state.items()}
    one.advance(20)
    same(state, kept)


def test_new_rows_are_told_once_and_in_the_order_of_time(world):
    one = learner(world)
    one.advance(30)
    first = one.new_rows()
    one.advance(5)
    second = one.new_rows()
    assert first.shape == (30, 3, WIDTH)
    assert second.shape == (5, 3, WIDTH)
    assert one.new_rows().shape == (0, 3, WIDTH)
    rows = np.concatenate([first, second])
    going_on = rows[:-1, :, 9] == 0
    np.testing.assert_array_equal(rows[:-1, :, 5:8][going_on], rows[1:, :, :3][going_on])


def test_an_episode_that_is_cut_is_marked_last_and_bootstraps(world):
    one = learner(world)
    one.advance(40)
    rows = one.new_rows()
    length = world.mdp.decisions_per_episode
    np.testing.assert_array_equal(np.flatnonzero(rows[:, 0, 9]), np.arange(length - 1, 40, length))
    assert (rows[..., 8] == np.float32(world.mdp.discount)).all()


def test_contact_ends_an_episode_only_where_the_process_says_so(world):
    mdp = world.mdp.model_copy(update={"terminate_on_contact": True, "start_gap_m": (0.0155, 0.0155)})
    one = learner(world, mdp=mdp)
    one.advance(60)
    rows = one.new_rows()
    ended = rows[..., 8] == 0
    assert ended.any()
    assert (rows[..., 9][ended] == 1).all()


def test_held_exploratory_actions_are_held(world):
    one = learner(world, exploratory_hold_ms=30.0)
    one.advance(60)
    explored = one.new_rows()[:, 0, 3].reshape(-1, 3)
    assert (explored == explored[:, :1]).all()
    assert len(np.unique(explored[:, 0])) == 20


def test_the_learning_rates_fall_to_the_stated_fraction(world):
    one = learner(world)
    one.advance(61)
    assert one.agent.critic_adam.learning_rate == world.training.critic_learning_rate
    one.advance(59)
    left = one.agent.actor_adam.learning_rate / world.training.actor_learning_rate
    assert left == pytest.approx(1 - 0.95 * 59 / 60)


def test_padding_is_not_shown(world):
    one = learner(world, seeds=[5])
    assert one.actors()["w3"].shape[0] == one.critics()["w3"].shape[1] == 1
    assert one.critics()["w3"].shape[0] == 2
    assert one.responses(np.array([0.006, 0.01])).gap_m.shape[1] == 2


@pytest.mark.parametrize(
    "changes",
    [
        {"n_step": 4},
        {"layer_norm_critic": False},
        {"cloning_weight": 1.0},
        {"critic_root_offset": 0.0},
        {"saturation_weight": 0.0, "actor_last_layer_scale": 40.0},
    ],
)
def test_each_lead_changes_what_is_learned(world, prefilled_rows, changes):
    plain, other = learner(world, prefill=prefilled_rows), learner(world, prefill=prefilled_rows, **changes)
    for one in (plain, other):
        one.advance(120)
        assert all(np.isfinite(value).all() for value in one.actors().values())
    assert not np.array_equal(plain.actors()["w1"], other.actors()["w1"])
