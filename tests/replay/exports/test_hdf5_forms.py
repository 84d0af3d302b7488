"""What lies in the HDF5 files, without the libraries that read them: test_d3rlpy and test_minari have those."""

import json

import h5py
import numpy as np
import pytest

from maglev_offline.errors import InputError


def test_an_episode_for_d3rlpy_has_two_steps_or_ends_terminated(written, rows):
    with h5py.File(written("d3rlpy") / "prefill.h5") as file:
        found = {name: file[name][()] for name in file}
        assert file.attrs["gamma"] == 0.9
        assert file.attrs["construction"] == "raw"
    last = found["episode_terminals"] == 1
    assert last.sum() == 100
    assert len(last) == 200 - rows.terminated.sum()
    np.testing.assert_array_equal(found["terminals"][last], rows.terminated)
    first = np.r_[True, last[:-1]]
    np.testing.assert_array_equal(found["observations"][first], rows.observation)
    np.testing.assert_array_equal(found["actions"][first], rows.action)
    np.testing.assert_array_equal(found["rewards"][first], rows.reward)
    np.testing.assert_array_equal(found["observations"][~first], rows.next_observation[~rows.terminated])


def test_an_episode_for_minari_is_one_row_with_both_observations(written, rows):
    data = written("minari") / "maglev-offline/prefill-v0/data"
    about = json.loads((data / "metadata.json").read_text())
    assert (about["total_episodes"], about["total_steps"]) == (100, 100)
    assert json.loads(about["action_space"])["high"] == [1.0]
    with h5py.File(data / "main_data.hdf5") as file:
        for row in (0, 24, 99):
            one = file[f"episode_{row}"]
            np.testing.assert_array_equal(one["observations"], [rows.observation[row], rows.next_observation[row]])
            np.testing.assert_array_equal(one["actions"], [rows.action[row]])
            np.testing.assert_array_equal(one["rewards"], [rows.reward[row]])
            assert (one["terminations"][0], one["truncations"][0]) == (rows.terminated[row], not rows.terminated[row])


@pytest.mark.parametrize(("name", "library"), [("d3rlpy", "d3rlpy"), ("minari", "Minari")])
def test_rows_with_discounts_of_their_own_are_refused(written, semi_markov, name, library):
    with pytest.raises(InputError, match=f"semi_markov.*{library} has one discount for all rows"):
        written(name, semi_markov)


@pytest.mark.parametrize("name", ["d3rlpy", "minari"])
def test_without_h5py_it_says_what_to_install(written, monkeypatch, name):
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(InputError, match=r"needs the package h5py.*maglev-offline\[exports\]"):
        written(name)
