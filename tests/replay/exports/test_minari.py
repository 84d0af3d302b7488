"""With the real library, where it is installed: `make exports`."""

import numpy as np
import pytest

from maglev_offline.env import SuspensionEnv

minari = pytest.importorskip("minari")


def test_the_data_set_is_found_and_its_rows_are_equal(written, rows, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(written("minari")))
    assert list(minari.list_local_datasets()) == ["maglev-offline/prefill-v0"]
    found = minari.load_dataset("maglev-offline/prefill-v0")
    assert (found.total_episodes, found.total_steps) == (100, 100)
    env = SuspensionEnv()
    assert (found.spec.observation_space, found.spec.action_space) == (env.observation_space, env.action_space)
    for row, one in enumerate(found.iterate_episodes()):
        np.testing.assert_array_equal(one.observations, [rows.observation[row], rows.next_observation[row]])
        np.testing.assert_array_equal(one.actions, [rows.action[row]])
        np.testing.assert_array_equal(one.rewards, [rows.reward[row]])
        assert (one.terminations[0], one.truncations[0]) == (rows.terminated[row], not rows.terminated[row])


def test_episodes_can_be_sampled_and_filtered(written, rows, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(written("minari")))
    found = minari.load_dataset("maglev-offline/prefill-v0")
    assert len(list(found.sample_episodes(5))) == 5
    ended = found.filter_episodes(lambda episode: bool(episode.terminations[0]))
    assert ended.total_episodes == rows.terminated.sum()
