"""A training that is stopped, by Ctrl-C or by kill -9, goes on at its last checkpoint and ends in the same bytes."""

import signal
import subprocess
import sys

import pytest

from maglev_offline.agents import checkpoint, stage
from maglev_offline.agents.stage import Arm, train_arms
from maglev_offline.workspace import Workspace

ARM = Arm("td3", "empty", None)

WRITES = 3
"""A checkpoint reaches the disk in so many steps: its rows, its state, its name."""

KILLED = """
import os, signal, sys
from pathlib import Path
from maglev_offline.agents import checkpoint
from maglev_offline.agents.stage import Arm, World, train_arms
from maglev_offline.agents.settings import EvaluationSettings, TrainingSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.workspace import Workspace

root, at, *tables = sys.argv[1:]
calls, sync = [], os.fsync

def killing(handle):
    calls.append(handle)
    if len(calls) == int(at):
        os.kill(os.getpid(), signal.SIGKILL)
    sync(handle)

checkpoint.os.fsync = killing
kinds = (Plant, Mdp, TrainingSettings, EvaluationSettings)
world = World(*(kind.model_validate_json(table) for kind, table in zip(kinds, tables)))
train_arms(Workspace(Path(root)), [Arm("td3", "empty", None)], world)
"""


@pytest.fixture
def long_world(world, engine):
    """Five evaluations after the first, a checkpoint at each but the last, on each engine."""
    changes = {"steps": 300, "checkpoint_every": 1, "engine": engine, "n_step": 2, "batch_norm_actor": True}
    return world._replace(training=world.training.model_copy(update=changes))


def killed(root, write, world):
    """Train in a process that gets a SIGKILL just before a step of its way to the disk is safe there."""
    tables = [table.model_dump_json() for table in world]
    done = subprocess.run([sys.executable, "-c", KILLED, str(root), str(write), *tables], capture_output=True)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()


def stopped(root, write, world):
    """The same by Ctrl-C, in this process."""
    calls = []

    def sync(handle):
        calls.append(handle)
        if len(calls) == write:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint.os, "fsync", sync)
        with pytest.raises(KeyboardInterrupt):
            train_arms(Workspace(root), [ARM], world)


def trained(root, world, **options):
    """All files of the training artefacts, manifest and all; nothing else may lie there."""
    train_arms(Workspace(root), [ARM], world, **options)
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("engine", [pytest.param("torch", marks=pytest.mark.nightly), "native"], indirect=True)
def test_a_run_that_is_killed_twice_without_notice_ends_in_the_bytes_of_an_unbroken_one(tmp_path, long_world, heard):
    killed(tmp_path / "killed", WRITES + 1, long_world)
    killed(tmp_path / "killed", WRITES + 2, long_world)
    again = trained(tmp_path / "killed", long_world, progress=heard)
    assert "td3-empty/seeds-0000-0002 goes on at step 120 of 300." in heard.said
    assert heard.total == heard.done == 3 * (300 - 120)
    assert again == trained(tmp_path / "unbroken", long_world)


@pytest.mark.parametrize(("write", "step"), [(1, 0), (2, 0), (3, 60), (4, 60), (11, 180), (12, 240)])
def test_ctrl_c_loses_no_more_than_one_interval_wherever_it_comes(tmp_path, long_world, heard, write, step):
    stopped(tmp_path / "stopped", write, long_world)
    again = trained(tmp_path / "stopped", long_world, progress=heard)
    assert heard.total == 3 * (300 - step)
    assert again == trained(tmp_path / "unbroken", long_world)


def flip_first_byte(path):
    data = bytearray(path.read_bytes())
    data[0] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("settings", "it was made with other settings, inputs, versions or another engine"),
        ("versions", "it was made with other settings, inputs, versions or another engine"),
        ("instructions", "it was made with other settings, inputs, versions or another engine"),
        ("rows.f32", "it is damaged: rows.f32"),
        ("state.safetensors", "it is damaged: state.safetensors"),
    ],
)
def test_a_checkpoint_that_cannot_be_used_is_told_and_the_block_starts_anew(
    tmp_path, long_world, heard, monkeypatch, what, words
):
    stopped(tmp_path / "stopped", 8, long_world)
    (partial,) = tmp_path.glob("stopped/training/td3-empty/.*.partial")
    world = long_world
    if what == "settings":
        world = world._replace(training=world.training.model_copy(update={"exploration_std": 0.3}))
    elif what == "versions":
        monkeypatch.setattr(stage, "package_versions", lambda: {"torch": "0.1"})
    elif what == "instructions":
        monkeypatch.setattr(stage, "provenance", lambda _: {"instruction_set": "another"})
    else:
        flip_first_byte(partial / what)
    again = trained(tmp_path / "stopped", world, progress=heard)
    (warning,) = heard.warned
    assert "the checkpoint of td3-empty/seeds-0000-0002 is not used" in warning
    assert words in warning
    assert "trained from its first step" in warning
    assert again == trained(tmp_path / "unbroken", world)
