import errno
import fcntl
import json
import os
import tempfile

import pytest

from maglev_offline.doctor import place
from maglev_offline.doctor.resources import Needs
from maglev_offline.recipe import Recipe, remember
from maglev_offline.remote import CACHE
from maglev_offline.store import LOCK
from maglev_offline.workspace import Workspace

NOTHING = Needs(0, 0)


def states(where):
    return {check.code: check.state for check in place.place(str(where), NOTHING)}


def of(code, where):
    return next(check for check in place.place(str(where), NOTHING) if check.code == code)


@pytest.mark.parametrize("where", ["there", "not/there/yet"])
def test_a_workspace_is_tried_and_nothing_is_left_behind(tmp_path, where):
    (tmp_path / "there").mkdir()
    assert states(tmp_path / where) == dict.fromkeys(("workspace", "locking", "lock", "disk"), "ok")
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]


@pytest.mark.parametrize("where", ["file", "file/inside"])
def test_a_workspace_that_is_a_file_is_a_problem(tmp_path, where):
    (tmp_path / "file").touch()
    assert states(tmp_path / where) == {"workspace": "problem"}


def test_a_folder_that_cannot_be_written_is_a_problem(tmp_path, monkeypatch):
    def refused(**options):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(tempfile, "TemporaryDirectory", refused)
    check = of("workspace", tmp_path)
    assert (check.state, "Permission denied" in check.what) == ("problem", True)
    assert check.todo == f"Make {tmp_path} writable for you, or give another --workspace."


def test_a_file_system_that_cannot_lock_is_a_problem(tmp_path, monkeypatch):
    def without_locks(file, how):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", without_locks)
    check = of("locking", tmp_path)
    assert (check.state, check.todo) == ("problem", "Give another --workspace, on a local disk.")
    assert "No locks available" in check.what


def test_a_lock_that_is_held_says_by_whom(tmp_path):
    with Workspace(tmp_path).lock("transfer"):
        check = of("lock", tmp_path)
    assert (check.state, check.facts["holder"]) == (
        "problem",
        f"`maglev-offline transfer` (process {os.getpid()})",
    )
    assert of("lock", tmp_path).state == "ok"


def test_the_name_of_a_command_that_was_killed_holds_nothing(tmp_path):
    (tmp_path / ".lock").write_text("`maglev-offline train` (process 7)")
    assert of("lock", tmp_path).state == "ok"


@pytest.fixture
def address(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE, str(tmp_path / "cache"))
    (tmp_path / "bucket").mkdir()
    return f"file://{tmp_path}/bucket"


def test_a_workspace_in_a_store_is_tried_there(address, tmp_path):
    assert states(address) == dict.fromkeys(("workspace", "lock", "disk"), "ok")
    assert list((tmp_path / "bucket").iterdir()) == []


def test_a_lock_in_a_store_says_by_whom(address, tmp_path):
    (tmp_path / "bucket" / LOCK).write_text(json.dumps({"command": "train", "host": "elsewhere", "process": 7}))
    check = of("lock", address)
    assert check.state == "problem"
    assert "`maglev-offline train` (process 7 on elsewhere)" in check.what


def test_a_store_that_nothing_opens_is_a_problem_of_the_workspace_alone():
    (check,) = place.place("nothing://there", NOTHING)
    assert (check.code, check.state) == ("workspace", "problem")
    assert place.known_recipe(None, "nothing://there")[1].state == "note"


def test_the_recipe_is_the_one_given_or_remembered_or_none(tmp_path):
    (tmp_path / "own.toml").write_text('name = "own"\n')
    assert place.known_recipe(tmp_path / "own.toml", str(tmp_path))[1].facts == {"name": "own"}
    assert place.known_recipe(None, str(tmp_path))[1].what == "none, so the defaults"
    remember(tmp_path, Recipe(name="kept"))
    assert place.known_recipe(None, str(tmp_path))[1].what == "kept (remembered by the workspace)"
    assert place.known_recipe(None, f"file://{tmp_path}")[1].facts == {"name": "kept"}


@pytest.mark.parametrize("text", ["name =", "[training]\nsteps = 0\n"])
def test_a_recipe_that_cannot_be_used_is_a_problem(tmp_path, text):
    (tmp_path / "bad.toml").write_text(text)
    found, check = place.known_recipe(tmp_path / "bad.toml", str(tmp_path))
    assert (found, check.state, check.facts) == (None, "problem", {"name": None})


def test_a_recipe_that_nobody_may_read_is_a_problem(tmp_path, monkeypatch):
    from maglev_offline import recipe

    def refused(path):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(recipe, "load_recipe", refused)
    assert place.known_recipe(tmp_path / "x.toml", str(tmp_path))[1].state == "problem"
