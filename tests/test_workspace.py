import json
import os
import pickle
import subprocess
import sys
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline import hashes
from maglev_offline import workspace as module
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.errors import ArtefactError, InputError, WorkspaceLocked
from maglev_offline.mdp import Mdp
from maglev_offline.replay.settings import PrefillSettings
from maglev_offline.workspace import (
    Manifest,
    Workspace,
    changed_files,
    fingerprint,
    input_hash,
    package_versions,
    sha256_of,
)

HOLDER = """
import sys
import time
from pathlib import Path
from maglev_offline.workspace import Workspace
with Workspace(Path(sys.argv[1])).lock("train"):
    print("locked", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def workspace(tmp_path):
    return Workspace(tmp_path / "workspace")


def put(workspace, text, *parts, mark="mark"):
    home = workspace.path(*parts)
    with workspace.commit(home, Manifest("/".join(parts), mark, {})) as draft:
        (draft / "part").mkdir()
        (draft / "data.txt").write_text(text)
        (draft / "part/more.txt").write_text(text * 2)
    return home


def test_an_artefact_is_its_files_and_a_manifest_with_their_hashes(workspace):
    home = put(workspace, "abc", "samples", "log-a")
    manifest = Manifest.read(home)
    assert manifest.files == {
        "data.txt": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
        "part/more.txt": sha256_of(home / "part/more.txt"),
    }
    assert manifest.versions == package_versions()
    assert {p.name for p in home.iterdir()} == {"data.txt", "part", "manifest.json"}


def test_the_same_content_gives_the_same_manifest(workspace, tmp_path):
    one, other = put(workspace, "abc", "a"), put(Workspace(tmp_path / "other"), "abc", "a")
    assert (one / "manifest.json").read_bytes() == (other / "manifest.json").read_bytes()
    assert input_hash(one) == input_hash(other) != input_hash(put(workspace, "abd", "a"))


def test_the_body_may_fill_in_the_manifest(workspace):
    manifest = Manifest("a", "mark", {})
    with workspace.commit(workspace.path("a"), manifest):
        manifest.counts["rows"] = 7
    assert Manifest.read(workspace.path("a")).counts == {"rows": 7}


def test_what_is_half_written_of_another_artefact_stays(workspace):
    """Names that begin alike are of two artefacts, which two workers may write at once."""
    with workspace.commit(workspace.path("log.2"), Manifest("log.2", "mark", {})) as draft:
        (draft / "x").write_text("x")
        for name in ("log", "log.", "log.2.3", "log-2"):
            with workspace.commit(workspace.path(name), Manifest(name, "mark", {})):
                pass
    assert (workspace.path("log.2") / "x").is_file()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_body_that_fails_leaves_the_old_artefact_and_no_draft(workspace, error):
    home = put(workspace, "old", "a")
    before = (home / "manifest.json").read_bytes()

    def fail():
        with workspace.commit(home, Manifest("a", "new", {})) as draft:
            (draft / "data.txt").write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert (home / "data.txt").read_text() == "old"
    assert (home / "manifest.json").read_bytes() == before
    assert [p.name for p in workspace.root.iterdir()] == ["a"]


def test_a_number_that_json_does_not_know_is_no_artefact(workspace):
    manifest = Manifest("a", "mark", {}, facts={"cost": float("nan")})
    with pytest.raises(ValueError, match="JSON"), workspace.commit(workspace.path("a"), manifest):
        pass
    assert list(workspace.root.iterdir()) == []


def test_a_failure_while_putting_in_place_brings_the_old_artefact_back(workspace, monkeypatch):
    home = put(workspace, "old", "a")
    rename = type(home).rename

    def fail_for_drafts(self, target):
        if self.name.endswith(".draft"):
            raise OSError("no space")
        return rename(self, target)

    monkeypatch.setattr(type(home), "rename", fail_for_drafts)
    with pytest.raises(OSError, match="no space"):
        put(workspace, "new", "a")
    assert (home / "data.txt").read_text() == "old"
    assert [p.name for p in workspace.root.iterdir()] == ["a"]


@pytest.mark.parametrize("which", [1, 2])
def test_an_interrupt_between_the_renames_leaves_the_old_artefact_or_the_new_one(workspace, monkeypatch, which):
    home = put(workspace, "old", "a")
    rename, count = type(home).rename, iter(range(1, 9))

    def interrupted(self, target):
        done = rename(self, target)
        if next(count) == which:
            raise KeyboardInterrupt
        return done

    monkeypatch.setattr(type(home), "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        put(workspace, "new", "a")
    assert (home / "data.txt").read_text() == {1: "old", 2: "new"}[which]
    assert [p.name for p in workspace.root.iterdir()] == ["a"]


def test_an_artefact_is_current_only_whole_and_from_the_same_inputs(workspace):
    home = put(workspace, "abc", "a")
    assert workspace.is_current(home, "mark")
    assert not workspace.is_current(home, "other")
    assert not workspace.is_current(workspace.path("b"), "mark")
    (home / "part/more.txt").unlink()
    assert not workspace.is_current(home, "mark")


@pytest.mark.parametrize("text", ["abd", "ab", ""])
def test_an_artefact_with_a_file_that_was_changed_is_neither_current_nor_an_input(workspace, text):
    home = put(workspace, "abc", "samples", "a")
    (home / "data.txt").write_text(text)
    assert not workspace.is_current(home, "mark")
    assert changed_files(home, Manifest.read(home)) == ["data.txt"]
    with pytest.raises(
        ArtefactError,
        match=r"samples/a: data\.txt is not what was written there\. Remove that folder and run its stage",
    ):
        input_hash(home)


def test_all_files_that_were_changed_are_named(workspace):
    home = put(workspace, "abc", "a")
    (home / "data.txt").write_text("other")
    (home / "part/more.txt").unlink()
    with pytest.raises(ArtefactError, match=r"data\.txt, part/more\.txt are not what was written there"):
        input_hash(home)


def test_a_file_that_was_written_again_as_it_was_changes_nothing(workspace):
    home = put(workspace, "abc", "a")
    before = input_hash(home)
    (home / "data.txt").write_text("abc")
    assert workspace.is_current(home, "mark")
    assert input_hash(home) == before


def test_a_list_holds_whole_artefacts_in_order_of_their_names(workspace):
    for name in ("b", "a", "c"):
        put(workspace, name, "samples", name)
    workspace.path("samples", ".d.draft").mkdir()
    workspace.path("samples", "e").mkdir()
    workspace.path("samples", "c", "manifest.json").unlink()
    assert [p.name for p in workspace.list("samples")] == ["a", "b"]
    assert workspace.list("prefill") == []


def test_an_artefact_of_another_schema_is_refused(workspace):
    home = put(workspace, "abc", "a")
    data = json.loads((home / "manifest.json").read_text()) | {"schema": 99}
    (home / "manifest.json").write_text(json.dumps(data))
    with pytest.raises(ArtefactError, match="has schema 99, this version reads 1"):
        Manifest.read(home)
    assert not workspace.is_current(home, "mark")


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema": 1}', '{"schema": 1, "colour": 3}', "\xff"])
def test_a_damaged_manifest_is_told_of(workspace, text):
    home = put(workspace, "abc", "a")
    (home / "manifest.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ArtefactError, match="manifest cannot be read"):
        Manifest.read(home)


def test_a_missing_artefact_says_to_run_its_stage(workspace, tmp_path):
    (tmp_path / "file").touch()
    for folder in (workspace.path("a"), tmp_path / "file"):
        with pytest.raises(ArtefactError, match=r"no such artefact.*Run the stage"):
            Manifest.read(folder)


def test_a_second_process_is_told_who_holds_the_workspace(workspace):
    command = [sys.executable, "-c", HOLDER, str(workspace.root)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "locked\n"
        with (
            pytest.raises(WorkspaceLocked, match=rf"`maglev-offline train` \(process {holder.pid}\)"),
            workspace.lock("run"),
        ):
            pass
        holder.communicate()
    with workspace.lock("run"):
        assert "maglev-offline run" in (workspace.root / ".lock").read_text()


def test_who_holds_a_workspace_can_be_asked_and_the_dead_hold_none(workspace):
    assert workspace.holder() is None
    with workspace.lock("train"):
        assert workspace.holder() == f"`maglev-offline train` (process {os.getpid()})"
    assert workspace.holder() is None
    (workspace.root / ".lock").write_text("`maglev-offline train` (process 7)")  # as a command leaves it that is killed
    assert workspace.holder() is None
    with workspace.lock("run"):
        pass


def test_the_lock_is_given_back_after_a_failure(workspace):
    with pytest.raises(ValueError, match="inside"), workspace.lock("train"):
        raise ValueError("inside")
    assert (workspace.root / ".lock").read_text() == ""
    with workspace.lock("train"):
        pass


def test_a_workspace_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").touch()
    for root in (tmp_path / "file", tmp_path / "file/inside"):
        with pytest.raises(InputError, match="a workspace is a folder"), Workspace(root).lock("train"):
            pass


DEFAULTS = (Mdp(), PrefillSettings())


def mark(stage="train", inputs=(("log", "1"),), settings=DEFAULTS, **options):
    return fingerprint(stage, dict(inputs), *settings, **options)


@pytest.mark.parametrize(
    "changes",
    [
        {"stage": "curate"},
        {"inputs": (("log", "2"),)},
        {"inputs": (("other", "1"),)},
        {"inputs": ()},
        {"settings": (Mdp(discount=0.8), PrefillSettings())},
        {"settings": (Mdp(), PrefillSettings(seed=1))},
        {"settings": (Mdp(),)},
        {"settings": (Mdp(), CurateSettings())},
        {"seeds": [1]},
        {"algorithm": "td3"},
    ],
)
def test_a_fingerprint_depends_on_each_argument(changes):
    assert mark(**changes) != mark()


def test_a_fingerprint_depends_on_the_version_and_the_schema(monkeypatch):
    before = mark()
    monkeypatch.setattr(module, "__version__", "99")
    other_version = mark()
    monkeypatch.setattr(module, "SCHEMA", 99)
    assert len({before, other_version, mark()}) == 3


@given(st.permutations([Mdp(), PrefillSettings(), CurateSettings()]))
def test_a_fingerprint_does_not_depend_on_the_order_of_its_tables(tables):
    assert mark(settings=tables) == mark(settings=(CurateSettings(), Mdp(), PrefillSettings()))


def test_two_tables_of_one_kind_would_hide_each_other_and_are_refused():
    with pytest.raises(ValueError, match="one kind"):
        mark(settings=(Mdp(), Mdp(discount=0.8)))


@pytest.fixture
def reads(monkeypatch):
    """Names of the files that were read to hash them, through the hashes that a workspace keeps."""
    found = []
    monkeypatch.setattr(hashes, "sha256_of", lambda path: found.append(path.name) or sha256_of(path))
    return found


def look(root, home, **options):
    """What a command does with an artefact, in a process of its own."""
    workspace = Workspace(root, **options)
    with workspace.lock("curate"):
        return workspace.is_current(home, "mark"), workspace.input_hash(home)


def test_the_files_of_an_artefact_that_nobody_touched_are_not_read_again(workspace, reads):
    home = put(workspace, "abc", "a")
    time.sleep(hashes.SETTLED_NS / 1e9 + 0.02)
    first = look(workspace.root, home)
    assert sorted(reads) == ["data.txt", "manifest.json", "more.txt"]
    assert look(workspace.root, home) == first == (True, input_hash(home))
    assert len(reads) == 3
    assert look(workspace.root, home, rehash=True) == first
    assert len(reads) == 6


@pytest.mark.parametrize("text", ["abd", "ab", ""])
def test_a_change_is_seen_although_the_hashes_were_known(workspace, text):
    home = put(workspace, "abc", "a")
    time.sleep(hashes.SETTLED_NS / 1e9 + 0.02)
    look(workspace.root, home)
    (home / "data.txt").write_text(text)
    again = Workspace(workspace.root)
    assert not again.is_current(home, "mark")
    assert again.current(home, "mark") is None
    with pytest.raises(ArtefactError, match=r"data\.txt is not what was written there"):
        again.input_hash(home)


def test_a_current_artefact_comes_with_its_manifest(workspace):
    home = put(workspace, "abc", "a")
    assert workspace.current(home, "mark") == Manifest.read(home)
    assert workspace.current(home, "other") is None
    assert workspace.current(workspace.path("none"), "mark") is None


def test_a_workspace_goes_to_a_worker_without_the_hashes(workspace):
    put(workspace, "abc", "a")
    workspace.known.keep("/log", hashes.Stamp(1, 2, 3, 4), "0" * 64)
    there = pickle.loads(pickle.dumps(Workspace(workspace.root, rehash=True)))
    assert (there.root, there.rehash) == (workspace.root, True)
    assert b"/log" not in pickle.dumps(workspace)


def test_a_manifest_is_read_again_once_it_was_written_again(workspace):
    home = put(workspace, "abc", "a")
    assert workspace.manifest(home) is workspace.manifest(home)
    put(workspace, "abd", "a", mark="other")
    assert workspace.manifest(home) == Manifest.read(home)
    assert workspace.manifest(home).fingerprint == "other"
    (home / "manifest.json").unlink()
    with pytest.raises(ArtefactError, match="no such artefact"):
        workspace.manifest(home)


def killed_in(workspace, *left):
    """The workspace as a command leaves it that is killed: its name in the lock, and what it had not put in place."""
    workspace.root.mkdir(parents=True, exist_ok=True)
    (workspace.root / ".lock").write_text("`maglev-offline ingest` (process 1)")
    for name in left:
        workspace.path(name).mkdir(parents=True)
        workspace.path(name, "half.txt").write_text("half")


def test_what_a_killed_command_left_half_written_goes_away_with_the_next_one(workspace):
    home = put(workspace, "abc", "samples", "a")
    killed_in(workspace, "samples/.a.0123abcd.draft", "samples/.a.0123abcd.old", ".b.89abcdef.draft", ".keep")
    (workspace.root / ".recipe.json.0a1b2c3d.draft").write_text("half")
    with workspace.lock("curate"):
        assert workspace.is_current(home, "mark")
    assert {p.name for p in workspace.root.iterdir()} - {module.KNOWN_HASHES} == {".lock", ".keep", "samples"}
    assert [p.name for p in home.parent.iterdir()] == ["a"]


def test_what_a_lost_worker_left_half_written_goes_away_while_the_command_goes_on(workspace):
    home = put(workspace, "abc", "samples", "a")
    killed_in(workspace, "samples/.b.0123abcd.draft", ".ticks.89abcdef.draft")
    workspace.tidy("samples")
    assert [p.name for p in home.parent.iterdir()] == ["a"]
    assert workspace.path(".ticks.89abcdef.draft").is_dir()


def test_what_another_machine_made_is_waited_for(workspace):
    home = put(workspace, "abc", "samples", "a")
    late = home.rename(workspace.root / "late")
    comes = threading.Timer(0.05, late.rename, [home])
    comes.start()
    workspace.wait_for(home, "mark")
    comes.join()
    assert [p.name for p in home.parent.iterdir()] == ["a"]


def test_what_another_machine_made_and_nobody_sees_is_an_error(workspace, monkeypatch):
    monkeypatch.setattr(module, "LATE_S", 0.0)
    home = put(workspace, "abc", "samples", "a", mark="older")
    with pytest.raises(ArtefactError, match="samples/a: another machine made this, and it is not seen here"):
        workspace.wait_for(home, "mark")


def test_files_of_others_in_the_folder_stay_as_they_are(workspace):
    """A workspace may be the folder that one works in: hidden names of that kind are not all ours."""
    killed_in(workspace, "proj/.cfg.old", "proj/.cfg.draft", ".plan.0123abc.draft", ".git/.x.0123abcd.draft")
    (workspace.root / ".bashrc.old").write_text("mine")
    (workspace.root / "notes").mkdir()
    (workspace.root / "notes/.plan.draft").write_text("mine")
    before = sorted(p for p in workspace.root.rglob("*") if p.name != ".lock")
    with workspace.lock("curate"):
        assert sorted(p for p in workspace.root.rglob("*") if p.name != ".lock") == before


def test_the_next_command_holds_the_workspace_before_it_sweeps(workspace, monkeypatch):
    """Else a worker of the killed one could go on between the two; and a kill while sweeping still leaves a name."""
    killed_in(workspace)
    seen = []
    monkeypatch.setattr(module, "sweep", lambda root: seen.append((root / ".lock").read_text()))
    with workspace.lock("curate"):
        assert seen[0].startswith("`maglev-offline curate`")


def test_two_holders_of_one_command_and_number_are_two(workspace):
    with workspace.lock("ingest"):
        worker = pickle.loads(pickle.dumps(workspace))
    with Workspace(workspace.root).lock("ingest"), pytest.raises(WorkspaceLocked):
        put(worker, "late", "a")


def test_an_artefact_that_a_killed_command_had_put_aside_comes_back(workspace):
    home = put(workspace, "abc", "samples", "a")
    home.rename(home.with_name(".a.0123abcd.old"))
    killed_in(workspace)
    with workspace.lock("curate"):
        assert workspace.is_current(home, "mark")


def test_a_worker_that_a_killed_command_left_behind_writes_nothing_into_the_work_of_the_next(workspace):
    with workspace.lock("ingest"):
        worker = pickle.loads(pickle.dumps(workspace))
    with (
        Workspace(workspace.root).lock("curate"),
        pytest.raises(WorkspaceLocked, match="has gone over to `maglev-offline curate`"),
    ):
        put(worker, "late", "a")
    assert not workspace.path("a").exists()
