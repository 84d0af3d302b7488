"""With the real library: rows go in equal, and it learns from them."""

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import DDPG, TD3
from stable_baselines3.common.buffers import NStepReplayBuffer, ReplayBuffer
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from maglev_offline.env import SuspensionEnv
from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.mdp import Mdp
from maglev_offline.replay.exports.sb3 import fill, fill_model

SEEN, ACTS = gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32), gymnasium.spaces.Box(-1, 1, (1,), np.float32)
TINY = {"policy_kwargs": {"net_arch": [8, 8]}, "batch_size": 16, "learning_starts": 0, "device": "cpu", "seed": 3}


def model_of(kind=DDPG, env=None, gamma=0.9, capacity=400):
    return kind("MlpPolicy", env or SuspensionEnv(), gamma=gamma, buffer_size=capacity, **TINY)


@pytest.fixture
def folder(written):
    return written("sb3")


@pytest.mark.parametrize("handled", [True, False], ids=["time-outs handled", "time-outs not handled"])
def test_rows_come_out_of_the_buffer_as_they_went_in(folder, rows, handled):
    buffer = ReplayBuffer(101, SEEN, ACTS, "cpu", handle_timeout_termination=handled)
    assert fill(buffer, folder) == buffer.size() == 100
    batch = buffer._get_samples(np.arange(100))
    np.testing.assert_array_equal(batch.observations, rows.observation)
    np.testing.assert_array_equal(batch.actions, rows.action)
    np.testing.assert_array_equal(batch.rewards[:, 0], rows.reward)
    np.testing.assert_array_equal(batch.next_observations, rows.next_observation)
    np.testing.assert_array_equal(batch.dones[:, 0], rows.terminated)


def test_no_sum_of_rewards_runs_from_one_row_into_the_next(folder, rows):
    buffer = NStepReplayBuffer(101, SEEN, ACTS, "cpu", n_steps=3, gamma=0.9)
    fill(buffer, folder)
    batch = buffer._get_samples(np.arange(100))
    np.testing.assert_array_equal(batch.rewards[:, 0], rows.reward)
    np.testing.assert_array_equal(batch.next_observations, rows.next_observation)
    np.testing.assert_allclose(batch.discounts, 0.9, rtol=1e-6)


@pytest.mark.parametrize("kind", [DDPG, TD3])
def test_it_trains_on_from_the_prefill(folder, rows, kind):
    model = model_of(kind)
    assert fill_model(model, folder) == 100
    before = [w.clone() for w in model.actor.parameters()]
    model.learn(200)
    assert any(not a.equal(b) for a, b in zip(before, model.actor.parameters(), strict=True))
    assert model.replay_buffer.size() == 300
    np.testing.assert_array_equal(model.replay_buffer.observations[:100, 0], rows.observation)
    assert all(w.isfinite().all() for w in model.policy.parameters())


@pytest.mark.parametrize(
    ("buffer", "words"),
    [
        ({"buffer_size": 100}, "100 prefilled rows do not fit into 100 slots"),
        ({"buffer_size": 800, "n_envs": 2}, "the buffer is of 2 environments"),
        (
            {"buffer_size": 400, "optimize_memory_usage": True, "handle_timeout_termination": False},
            "keeps no next observations",
        ),
        (
            {"buffer_size": 400, "action_space": gymnasium.spaces.Box(-200, 200, (1,))},
            r"actions of the buffer lie in \[-200, 200\].*Scale the environment",
        ),
        ({"buffer_size": 400, "observation_space": gymnasium.spaces.Box(-1, 1, (4,))}, r"observations \(4,\)"),
    ],
)
def test_a_buffer_that_cannot_hold_the_rows_is_refused_and_stays_empty(folder, buffer, words):
    made = ReplayBuffer(**{"observation_space": SEEN, "action_space": ACTS, "device": "cpu", **buffer})
    with pytest.raises(InputError, match=words):
        fill(made, folder)
    assert made.size() == 0


def test_a_buffer_is_filled_once(folder):
    buffer = ReplayBuffer(400, SEEN, ACTS, "cpu")
    fill(buffer, folder)
    with pytest.raises(InputError, match="holds rows already"):
        fill(buffer, folder)


def test_a_model_that_reads_the_rows_otherwise_than_they_were_made_is_refused(folder):
    with pytest.raises(InputError, match=r"gamma = 0.99, .* for 0.9.*Make the model with gamma=0.9"):
        fill_model(model_of(gamma=0.99), folder)
    with pytest.raises(InputError, match="VecNormalize, which would scale twice"):
        fill_model(model_of(env=VecNormalize(DummyVecEnv([SuspensionEnv]))), folder)
    with pytest.raises(InputError, match=r"gap_scale_m = 0.001, and the rows 0.0025"):
        fill_model(model_of(env=SuspensionEnv(mdp=Mdp(gap_scale_m=0.001))), folder)


def test_rows_that_the_library_cannot_hold_are_not_written(written, semi_markov):
    with pytest.raises(InputError, match=r"semi_markov.*Stable-Baselines3 has one discount"):
        written("sb3", semi_markov)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"reward": np.nan}, "row 5, column rewards: the value is not finite"),
        ({"action": 1.5}, r"row 5, column action: 1.5 lies outside"),
    ],
)
def test_a_file_with_rows_that_cannot_be_used_is_refused(written, rows, change, words):
    name, value = next(iter(change.items()))
    column = getattr(rows, name).copy()
    column[5] = value
    folder = written("sb3", rows._replace(**{name: column}))
    with pytest.raises(InputError, match=words):
        fill(ReplayBuffer(400, SEEN, ACTS, "cpu"), folder)


def test_what_is_no_such_file_is_told_of(folder, tmp_path):
    buffer = ReplayBuffer(400, SEEN, ACTS, "cpu")
    with pytest.raises(ArtefactError, match=r"no prefill for Stable-Baselines3.*--format sb3"):
        fill(buffer, tmp_path / "nowhere")
    (folder / "replay_buffer.safetensors").write_bytes(b"\x08")
    with pytest.raises(ArtefactError, match="no prefill for Stable-Baselines3"):
        fill(buffer, folder)
