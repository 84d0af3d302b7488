import multiprocessing
import os
import time

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save

from maglev_offline.agents import checkpoint as module
from maglev_offline.agents.checkpoint import Checkpoint, Unusable
from maglev_offline.replay.buffer import WIDTH

STATE = {
    "net.w1": np.arange(6, dtype=np.float32).reshape(2, 3),
    "streams": np.array([[2**63 + 1, 7]], dtype=np.uint64),
    "step": np.array(40),
    "diverged": np.array([True, False]),
}


def rows(n, first=0):
    return (first + np.arange(n * 2 * WIDTH, dtype=np.float32)).reshape(n, 2, WIDTH)


@pytest.fixture
def saved(tmp_path):
    """A checkpoint after two saves: at step 20 with three rows, at step 40 with five."""
    one = Checkpoint(tmp_path / "partial", "mark", 2)
    one.folder.mkdir()
    one.save(20, STATE, rows(3))
    one.save(40, STATE, rows(2, first=1000))
    return one


def again(saved, mark="mark"):
    return Checkpoint(saved.folder, mark, 2)


def test_what_was_saved_comes_back_to_the_last_bit(saved):
    found = again(saved).load(most_rows=100)
    assert found.step == 40
    assert found.state.keys() == STATE.keys()
    for name, value in STATE.items():
        assert found.state[name].dtype == value.dtype
        np.testing.assert_array_equal(found.state[name], value)
    np.testing.assert_array_equal(found.rows, np.concatenate([rows(3), rows(2, first=1000)]))


def test_the_rows_are_appended_and_never_written_twice(saved):
    assert (saved.folder / module.ROWS).stat().st_size == 5 * 2 * WIDTH * 4


def test_no_more_rows_are_read_than_a_buffer_holds(saved):
    np.testing.assert_array_equal(again(saved).load(most_rows=2).rows, rows(2, first=1000))


def test_where_nothing_was_saved_there_is_none(tmp_path):
    assert Checkpoint(tmp_path / "partial", "mark", 2).load(1) is None


def test_the_next_save_goes_on_behind_the_rows_that_were_loaded(saved):
    other = again(saved)
    other.load(1)
    other.save(60, STATE, rows(1, first=5000))
    assert len(again(saved).load(100).rows) == 6


def test_a_new_start_cuts_off_what_lay_there(saved):
    fresh = again(saved, "another mark")
    fresh.save(20, STATE, rows(1))
    assert len(again(saved, "another mark").load(100).rows) == 1


@pytest.mark.parametrize("place", range(3))
def test_a_save_that_is_cut_short_leaves_the_one_before_it_or_is_whole(saved, monkeypatch, place):
    """Stopped at each point at which something reaches the disk: the rows, the new state, the new name."""
    calls = []

    def sync(handle):
        calls.append(handle)
        if len(calls) == place + 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(module.os, "fsync", sync)
    with pytest.raises(KeyboardInterrupt):
        saved.save(60, STATE, rows(4, first=7000))
    found = again(saved).load(100)
    assert (found.step, len(found.rows)) == ((60, 9) if place == 2 else (40, 5))


def test_another_mark_is_told_of(saved):
    with pytest.raises(Unusable, match="other settings, inputs, versions or another engine"):
        again(saved, "another mark").load(1)


def damaged(path, kind):
    data = bytearray(path.read_bytes())
    if kind == "flipped":
        data[-5] ^= 1
    elif kind == "cut":
        del data[-7:]
    elif kind == "emptied":
        data.clear()
    path.write_bytes(data)


@pytest.mark.parametrize("kind", ["flipped", "cut", "emptied"])
@pytest.mark.parametrize("name", [module.ROWS, module.STATE])
def test_damage_is_told_of(saved, name, kind):
    damaged(saved.folder / name, kind)
    with pytest.raises(Unusable, match=f"it is damaged: {name}"):
        again(saved).load(1)


def test_rows_that_are_gone_are_damage(saved):
    (saved.folder / module.ROWS).unlink()
    with pytest.raises(Unusable, match=f"{module.ROWS} cannot be read"):
        again(saved).load(1)


def test_it_is_forgotten_when_the_block_is_done(saved):
    saved.remove()
    assert not saved.folder.exists()
    saved.remove()


def _hold(folder, seconds, ready):
    with Checkpoint(folder, "mark", 2).held():
        ready.set()
        time.sleep(seconds)


@pytest.mark.parametrize("removed", [False, True])
def test_one_at_a_time_is_at_work_on_it(tmp_path, removed):
    ready = multiprocessing.get_context("fork").Event()
    other = multiprocessing.get_context("fork").Process(target=_hold, args=(tmp_path / "partial", 0.6, ready))
    other.start()
    ready.wait()
    began = time.monotonic()
    if removed:
        os.unlink(tmp_path / "partial" / module.LOCK)  # noqa: PTH108
    with Checkpoint(tmp_path / "partial", "mark", 2).held():
        waited = time.monotonic() - began
    other.join()
    assert (waited > 0.3) is not removed


@pytest.mark.parametrize(("name", "value"), [("step", 41), ("rows", 4), ("rows", -1), ("rows", 2**62)])
def test_a_number_that_was_changed_is_damage(saved, name, value):
    path = saved.folder / module.STATE
    with safe_open(path, framework="numpy") as file:
        about = file.metadata() | {name: str(value)}
    path.write_bytes(save(STATE, about))
    with pytest.raises(Unusable, match="it is damaged"):
        again(saved).load(1)


def test_a_checkpoint_is_ours_by_its_mark_alone(saved, tmp_path):
    """So that a finished block does not take along what a longer training of it has left."""
    assert Checkpoint(saved.folder, "mark", 2).is_ours()
    assert not Checkpoint(saved.folder, "of more steps", 2).is_ours()
    assert not Checkpoint(tmp_path / "none", "mark", 2).is_ours()
