import json
import os
import shutil
import socket
import subprocess
import sys

import pytest
from pyarrow import fs

from maglev_offline import remote, store
from maglev_offline.errors import ArtefactError, InputError, WorkspaceLocked
from maglev_offline.hashes import sha256_of
from maglev_offline.remote import CACHE, Mirror, mirror_of, open_workspace
from maglev_offline.store import LOCK, Store
from maglev_offline.workspace import Manifest, Workspace, changed_files


@pytest.fixture
def there(tmp_path):
    """Folder that stands for the bucket."""
    (tmp_path / "bucket").mkdir()
    return tmp_path / "bucket"


@pytest.fixture
def address(there, tmp_path, monkeypatch):
    """Address of a workspace in it."""
    monkeypatch.setenv(CACHE, str(tmp_path / "cache"))
    return f"file://{there}/workspace"


def put(root, text, *parts, more="more"):
    workspace = Workspace(root)
    home = workspace.path(*parts)
    with workspace.commit(home, Manifest("/".join(parts), "mark", {})) as draft:
        (draft / "data.txt").write_text(text)
        (draft / "part").mkdir()
        (draft / "part/more.txt").write_text(more)
    return home


def read(root, *parts):
    """Text of an artefact, which must be whole."""
    home = root.joinpath(*parts)
    assert changed_files(home, Manifest.read(home)) == []
    return (home / "data.txt").read_text()


@pytest.fixture
def from_elsewhere(address, tmp_path):
    """Open the workspace as another machine does, whose mirror is its own."""
    numbers = iter(range(100))

    def open_there(mirror=None):
        return open_workspace(address, cache=tmp_path / (mirror or f"elsewhere{next(numbers)}"))

    return open_there


def test_a_local_path_is_its_own_workspace(tmp_path):
    for where in (tmp_path / "workspace", str(tmp_path / "workspace")):
        with open_workspace(where) as root:
            assert root == tmp_path / "workspace"
    assert list(tmp_path.iterdir()) == []


def test_what_is_made_here_is_found_from_elsewhere(address, from_elsewhere):
    with open_workspace(address) as root:
        put(root, "abc", "samples", "log-a")
        (root / "recipe.json").write_text("{}")
        (root / ".known_hashes.json").write_text("mine")
    with from_elsewhere() as root:
        assert read(root, "samples", "log-a") == "abc"
        assert (root / "recipe.json").read_text() == "{}"
        assert not (root / ".known_hashes.json").exists()


def test_a_file_keeps_its_name_in_the_store_below_a_folder_of_its_hash(address, there):
    with open_workspace(address) as root:
        home = put(root, "abc", "a")
    assert (there / "workspace/a" / sha256_of(home / "data.txt")[:32] / "data.txt").read_text() == "abc"
    assert (there / "workspace/a/manifest.json").read_bytes() == (home / "manifest.json").read_bytes()


def test_what_is_changed_or_removed_here_is_changed_or_removed_there(address, there, from_elsewhere):
    with open_workspace(address) as root:
        put(root, "old", "a")
        put(root, "gone", "b")
        (root / "notes.txt").write_text("gone")
    with open_workspace(address) as root:
        put(root, "new", "a")
        shutil.rmtree(root / "b")
        (root / "notes.txt").unlink()
    with from_elsewhere() as root:
        assert read(root, "a") == "new"
        assert not (root / "b").exists()
        assert not (root / "notes.txt").exists()
    texts = [path.read_text() for path in there.rglob("data.txt")]
    assert texts == ["new"]


def test_what_is_changed_or_removed_elsewhere_is_changed_or_removed_here(address, from_elsewhere):
    with open_workspace(address) as root:
        put(root, "old", "a")
        put(root, "gone", "b")
    with from_elsewhere("other") as root:
        put(root, "new", "a")
        shutil.rmtree(root / "b")
    with open_workspace(address) as root:
        assert read(root, "a") == "new"
        assert not (root / "b").exists()


@pytest.fixture
def traffic(monkeypatch):
    """What was brought here and there, without the lock."""
    found = []
    fetch, send, put_ = Store.fetch, Store.send, Store.put
    look = Store.read

    def read_(self, name):
        found.extend([] if name == LOCK else [("read", name)])
        return look(self, name)

    monkeypatch.setattr(Store, "read", read_)
    monkeypatch.setattr(Store, "fetch", lambda self, name, *a: found.append(("fetch", name)) or fetch(self, name, *a))
    monkeypatch.setattr(Store, "send", lambda self, path, name: found.append(("send", name)) or send(self, path, name))

    def put_small(self, name, content):
        found.extend([] if name == LOCK else [("put", name)])
        put_(self, name, content)

    monkeypatch.setattr(Store, "put", put_small)
    return found


def test_nothing_is_brought_twice(address, traffic, from_elsewhere):
    with open_workspace(address) as root:
        put(root, "abc", "a")
        put(root, "abc", "b")
    with open_workspace(address):
        pass
    traffic.clear()
    with open_workspace(address):
        pass
    assert traffic == []

    with open_workspace(address) as root:
        put(root, "abd", "a")
    assert [(verb, name.split("/")[-1]) for verb, name in traffic] == [("send", "data.txt"), ("put", "manifest.json")]
    with from_elsewhere("other"):
        pass
    with open_workspace(address) as root:
        put(root, "abe", "a")
    traffic.clear()
    with from_elsewhere("other") as root:
        assert read(root, "a") == "abe"
    assert [(verb, name.split("/")[-1]) for verb, name in traffic] == [("read", "manifest.json"), ("fetch", "data.txt")]


def make_and_raise(address, error):
    with open_workspace(address) as root:
        put(root, "abc", "a")
        raise error


def test_a_body_that_fails_leaves_what_it_finished(address, from_elsewhere):
    with pytest.raises(ValueError, match="inside"):
        make_and_raise(address, ValueError("inside"))
    with from_elsewhere() as root:
        assert read(root, "a") == "abc"


def test_a_body_that_is_interrupted_brings_nothing_and_the_next_command_does(address, from_elsewhere):
    with pytest.raises(KeyboardInterrupt):
        make_and_raise(address, KeyboardInterrupt())
    with from_elsewhere() as root:
        assert not (root / "a").exists()
    with open_workspace(address) as root:
        assert read(root, "a") == "abc"
    with from_elsewhere() as root:
        assert read(root, "a") == "abc"


class FailsAtWrite(fs.FileSystemHandler):
    """A file system whose k-th write, move or removal fails, and every one after it."""

    def __init__(self, inner, k):
        self.inner, self.left = inner, k

    def _count(self):
        self.left -= 1
        if self.left < 0:
            raise OSError("the line went dead")

    def open_output_stream(self, path, metadata):
        stream = self.inner.open_output_stream(path)  # an empty file is left there, as a store may leave it
        self._count()
        return stream

    def move(self, src, dest):
        self._count()
        self.inner.move(src, dest)

    def delete_file(self, path):
        self._count()
        self.inner.delete_file(path)

    def delete_dir(self, path):
        self._count()
        self.inner.delete_dir(path)

    def create_dir(self, path, recursive):
        self.inner.create_dir(path, recursive=recursive)

    def open_input_stream(self, path):
        return self.inner.open_input_stream(path)

    def get_file_info(self, paths):
        return self.inner.get_file_info(paths)

    def get_file_info_selector(self, selector):
        return self.inner.get_file_info(selector)

    def get_type_name(self):
        return "fails"

    def normalize_path(self, path):
        return path

    def delete_dir_contents(self, path, missing_dir_ok=False): ...
    def delete_root_dir_contents(self): ...
    def copy_file(self, src, dest): ...
    def open_input_file(self, path): ...
    def open_append_stream(self, path, metadata): ...


@pytest.mark.parametrize("k", range(14))
def test_a_failure_on_the_way_leaves_every_artefact_whole_and_the_next_push_ends_it(tmp_path, there, monkeypatch, k):
    monkeypatch.setattr(remote, "THREADS", 1)
    inner = fs.SubTreeFileSystem(str(there), fs.LocalFileSystem())
    mine = tmp_path / "mine"
    mine.mkdir()
    first = Mirror(Store(inner, "ws", "s3://bucket/ws"), mine)
    first.pull()
    for name in ("a", "b", "c"):
        put(mine, f"old {name}", name)
    first.push()

    dead = fs.PyFileSystem(FailsAtWrite(inner, k))
    second = Mirror(Store(dead, "ws", "s3://bucket/ws"), mine)
    second.pull()
    put(mine, "new a", "a", more="other")
    put(mine, "new b", "b")
    shutil.rmtree(mine / "c")
    failed = False
    try:
        second.push()
    except InputError as error:
        failed = "the line went dead" in str(error)
        assert failed
    assert failed == (k < 12)  # a: 2 files, 2 for its manifest, 2 old files away; b: 1, 2, 1; c: 2 to remove it

    other = tmp_path / "other"
    other.mkdir()
    Mirror(Store(inner, "ws", "s3://bucket/ws"), other).pull()
    for name in ("a", "b"):
        assert read(other, name) in (f"old {name}", f"new {name}")
    assert not (other / "c").exists() or read(other, "c") == "old c"

    third = Mirror(Store(inner, "ws", "s3://bucket/ws"), mine)
    third.pull()
    assert [read(mine, name) for name in ("a", "b")] == ["new a", "new b"]
    third.push()
    last = tmp_path / "last"
    last.mkdir()
    Mirror(Store(inner, "ws", "s3://bucket/ws"), last).pull()
    assert [read(last, name) for name in ("a", "b")] == ["new a", "new b"]
    assert sorted(path.name for path in last.iterdir() if path.name[0] != ".") in (["a", "b"], ["a", "b", "c"])


def test_what_a_stopped_command_left_there_is_nobodys_and_is_swept_away(address, there, from_elsewhere):
    left = there / "workspace/a" / ("0" * 32) / "data.txt"
    left.parent.mkdir(parents=True)
    left.write_text("half")
    with from_elsewhere() as root:
        assert not (root / "a").exists()
    assert not left.exists()


def test_a_file_in_the_store_that_was_changed_is_refused(address, there, from_elsewhere):
    with open_workspace(address) as root:
        put(root, "abc", "a")
    next(there.rglob("data.txt")).write_text("abd")
    with pytest.raises(ArtefactError, match=r"not what was written there"), from_elsewhere("other"):
        pass


@pytest.mark.parametrize("name", ["../../evil.txt", "/evil.txt", "part/../../evil.txt", "", "manifest.json"])
def test_a_manifest_cannot_lead_out_of_its_artefact(address, there, from_elsewhere, tmp_path, name):
    with open_workspace(address) as root:
        put(root, "abc", "a")
    path = there / "workspace/a/manifest.json"
    data = json.loads(path.read_text())
    data["files"][name] = "0" * 64
    path.write_text(json.dumps(data))
    with pytest.raises(ArtefactError, match="the manifest cannot be read"), from_elsewhere("other"):
        pass
    assert not list(tmp_path.rglob("evil.txt"))


@pytest.mark.parametrize("text", ["", "{", "[]", '{"files": 3}', '{"files": {"a": "x"}}'])
def test_a_damaged_manifest_in_the_store_is_told_of(address, there, from_elsewhere, text):
    with open_workspace(address) as root:
        put(root, "abc", "a")
    (there / "workspace/a/manifest.json").write_text(text)
    with pytest.raises(ArtefactError, match="the manifest cannot be read"), from_elsewhere("other"):
        pass


def test_a_mirror_whose_memory_is_damaged_compares_everything_anew(address, from_elsewhere):
    with open_workspace(address) as root:
        put(root, "abc", "a")
    (root / ".mirror.json").write_text("{")
    with from_elsewhere("other") as elsewhere:
        put(elsewhere, "abd", "a")
    with open_workspace(address) as root:
        assert read(root, "a") == "abd"


def test_the_second_of_two_commands_is_told_who_works_there_and_since_when(address, from_elsewhere):
    who = rf"`maglev-offline train` \(process {os.getpid()} on {socket.gethostname()}\) since \d{{4}}-\d\d-\d\d"
    with (
        open_workspace(address, command="train"),
        pytest.raises(WorkspaceLocked, match=rf"in use by {who}.*remove file://.*\.lock\.json"),
        from_elsewhere("other"),
    ):
        pass
    with from_elsewhere("other"):
        pass


def test_the_lock_is_given_back_after_a_failure(address, there):
    with pytest.raises(ValueError, match="inside"), open_workspace(address):
        raise ValueError("inside")
    assert not list(there.rglob(LOCK))


def lock_of(there, **holder):
    (there / "workspace").mkdir()
    (there / "workspace" / LOCK).write_text(json.dumps({"command": "train", **holder}))


def test_the_lock_of_a_dead_process_of_this_machine_is_taken_over(address, there):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    lock_of(there, host=socket.gethostname(), process=dead.pid)
    with open_workspace(address):
        pass
    assert not list(there.rglob(LOCK))


@pytest.mark.parametrize("holder", [{"host": "elsewhere", "process": 1}, {"host": socket.gethostname()}, {}])
def test_the_lock_of_another_machine_or_of_nobody_known_holds(address, there, holder):
    lock_of(there, **holder)
    with pytest.raises(WorkspaceLocked, match="in use by `maglev-offline train`"), open_workspace(address):
        pass
    assert list(there.rglob(LOCK))


def test_a_lock_that_was_overwritten_in_the_same_instant_is_lost(address, there, monkeypatch):
    write = Store.put

    def overwritten(self, name, content):
        write(self, name, content)
        write(self, name, b'{"command": "ingest", "host": "other", "process": 7}')

    monkeypatch.setattr(Store, "put", overwritten)
    with (
        pytest.raises(WorkspaceLocked, match=r"`maglev-offline ingest` \(process 7 on other\)"),
        open_workspace(address),
    ):
        pass


def test_a_store_of_fsspec_works_as_well(tmp_path):
    memory = pytest.importorskip("fsspec").filesystem("memory")
    address = "memory://bucket/workspace"
    with open_workspace(address, cache=tmp_path / "one") as root:
        put(root, "abc", "samples", "a")
        put(root, "gone", "b")
    with open_workspace(address, cache=tmp_path / "two") as root:
        assert read(root, "samples", "a") == "abc"
        put(root, "abd", "samples", "a")
        shutil.rmtree(root / "b")
    with open_workspace(address, cache=tmp_path / "one") as root:
        assert read(root, "samples", "a") == "abd"
        assert not (root / "b").exists()
    memory.rm("/bucket", recursive=True)


def test_a_key_of_a_store_that_leads_elsewhere_is_not_mirrored():
    assert not any(store._is_plain(name) for name in ("../a", "a/../b", "/a", "a//b", ".lock.json", "a/.b/c", "a\0"))
    assert all(store._is_plain(name) for name in ("a", "a/b..c", "a/b c"))


def test_a_mirror_is_named_without_keys_and_each_address_has_its_own(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE, str(tmp_path))
    assert mirror_of("s3://key:secret@bucket/ws/") == mirror_of("s3://bucket/ws")
    assert mirror_of("s3://bucket/ws") != mirror_of("s3://bucket/ws?endpoint_override=other")
    assert mirror_of("s3://bucket/ws").is_relative_to(tmp_path)


def test_an_address_that_cannot_be_is_told_of(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE, str(tmp_path))
    with pytest.raises(InputError, match="nothing here that opens"), open_workspace("foo://x/y"):
        pass
