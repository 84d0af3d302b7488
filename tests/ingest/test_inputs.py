import re
from pathlib import Path

import pytest
from pyarrow import fs

from maglev_offline.errors import InputError
from maglev_offline.filesystems import open_address
from maglev_offline.ingest import inputs
from maglev_offline.ingest.inputs import find_logs


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A current folder with logs: two in `logs`, one below it, one beside, and a file that is no log."""
    for name in ("logs/b.mcap", "logs/a.mcap", "logs/deep/c.mcap", "d.mcap", "logs/notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def names(asked, **options):
    return [path.as_posix() for path in find_logs(asked, **options)]


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        (["d.mcap"], ["d.mcap"]),
        (["logs"], ["logs/a.mcap", "logs/b.mcap"]),
        (["logs/*.mcap"], ["logs/a.mcap", "logs/b.mcap"]),
        (["logs/[ab].mcap"], ["logs/a.mcap", "logs/b.mcap"]),
        (["**/*.mcap"], ["d.mcap", "logs/a.mcap", "logs/b.mcap", "logs/deep/c.mcap"]),
        (["log?"], ["logs/a.mcap", "logs/b.mcap"]),
        (["logs/b.mcap", "d.mcap", "logs/a.mcap"], ["d.mcap", "logs/a.mcap", "logs/b.mcap"]),
    ],
)
@pytest.mark.usefixtures("folder")
def test_paths_folders_and_patterns_become_a_sorted_list(asked, found):
    assert names(asked) == found


def test_a_log_that_is_named_in_several_ways_is_found_once(folder):
    assert names(["logs", "logs/a.mcap", "./logs/../logs/a.mcap", str(folder / "logs/b.mcap")]) == [
        "logs/a.mcap",
        "logs/b.mcap",
    ]


@pytest.mark.usefixtures("folder")
def test_a_file_is_taken_as_it_was_named_and_judged_later():
    assert names(["logs/notes.txt"]) == ["logs/notes.txt"]


def test_relative_names_start_from_the_given_folder(folder):
    home = folder / "pipelines"
    home.mkdir()
    assert [path.name for path in find_logs(["../logs/*.mcap"], relative_to=home)] == ["a.mcap", "b.mcap"]
    assert [path.name for path in find_logs(["../logs"], relative_to=home)] == ["a.mcap", "b.mcap"]
    assert find_logs([str(folder / "*.mcap")], relative_to=home) == [folder / "d.mcap"]


def test_brackets_in_a_name_are_no_pattern_where_the_file_is_there(folder):
    (folder / "run[1]").mkdir()
    (folder / "run[1]/log[2].mcap").touch()
    assert names(["run[1]/log[2].mcap"]) == ["run[1]/log[2].mcap"]
    assert [path.name for path in find_logs(["*.mcap"], relative_to=folder / "run[1]")] == ["log[2].mcap"]


@pytest.mark.parametrize("asked", ["none/*.mcap", "none?", "empty", "empt[y]"])
def test_a_folder_or_pattern_without_logs_is_named(folder, asked):
    (folder / "empty").mkdir()
    with pytest.raises(InputError, match=rf"^{re.escape(asked)}: no MCAP file is there\. Give paths"):
        find_logs(["d.mcap", asked])


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("asked", ["none.mcap", "logs/deep/none", "none/none.mcap"])
def test_a_path_that_is_not_there_is_passed_on_with_the_others_for_ingest_to_refuse(asked):
    assert sorted(names(["d.mcap", asked])) == sorted(["d.mcap", asked])
    assert names([asked, asked]) == [asked]


def test_a_relative_path_that_is_not_there_starts_from_the_given_folder(folder):
    assert find_logs(["none.mcap"], relative_to=folder / "logs") == [folder / "logs/none.mcap"]


def test_nothing_asked_for_is_told_of():
    with pytest.raises(InputError, match="no logs were named"):
        find_logs([])


@pytest.fixture
def bucket():
    """A store in memory with the same logs as `folder`, and one whose name holds a blank."""
    store = pytest.importorskip("fsspec").filesystem("memory")
    for name in ("logs/b.mcap", "logs/a.mcap", "logs/deep/c.mcap", "d.mcap", "logs/notes.txt", "odd/a b.mcap"):
        store.pipe(f"/bucket/{name}", b"log")
    yield store
    store.rm("/bucket", recursive=True)


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        (["d.mcap"], ["d.mcap"]),
        (["logs"], ["logs/a.mcap", "logs/b.mcap"]),
        (["logs/"], ["logs/a.mcap", "logs/b.mcap"]),
        (["logs/*.mcap"], ["logs/a.mcap", "logs/b.mcap"]),
        (["logs/[b-z].mcap"], ["logs/b.mcap"]),
        (["*/c*", "*/deep/*"], ["logs/deep/c.mcap"]),
        (["**/*.mcap"], ["d.mcap", "logs/a.mcap", "logs/b.mcap", "logs/deep/c.mcap", "odd/a%20b.mcap"]),
        (["odd/a%20*"], ["odd/a%20b.mcap"]),
        (["logs", "logs/a.mcap", "logs/*"], ["logs/a.mcap", "logs/b.mcap", "logs/notes.txt"]),
        (["none.mcap"], ["none.mcap"]),
    ],
)
@pytest.mark.usefixtures("bucket")
def test_addresses_of_files_folders_and_patterns_become_addresses_of_logs(asked, found):
    wanted = [f"memory://bucket/{name}" for name in found]
    if asked == ["*/c*", "*/deep/*"]:
        with pytest.raises(InputError, match="no MCAP file"):
            find_logs([f"memory://bucket/{asked[0]}"])
        asked = asked[1:]
    assert find_logs([f"memory://bucket/{name}" for name in asked]) == wanted


@pytest.mark.usefixtures("bucket")
def test_what_was_found_can_be_opened():
    (address,) = find_logs(["memory://bucket/odd"])
    store, path = open_address(address)
    with store.open_input_stream(path) as stream:
        assert stream.read() == b"log"


@pytest.mark.usefixtures("bucket")
def test_paths_come_before_addresses_and_a_file_address_is_a_path(folder):
    asked = ["memory://bucket/d.mcap", f"file://{folder}/logs/*.mcap", "d.mcap", f"file://{folder}/d.mcap"]
    found = find_logs(asked)
    assert found == [folder / "logs/a.mcap", folder / "logs/b.mcap", Path("d.mcap"), "memory://bucket/d.mcap"]


def test_the_order_of_local_logs_is_that_of_their_paths(folder):
    assert find_logs([f"file://{folder}/logs", "d.mcap"])[-1] == Path("d.mcap")


@pytest.mark.parametrize(
    "asked", ["memory://bucket/none/*.mcap", "memory://bucket/logs/*.bag", "foo://x/*", "memory://*"]
)
@pytest.mark.usefixtures("bucket")
def test_an_address_without_logs_is_told_of_in_plain_words(asked):
    with pytest.raises(InputError) as told:
        find_logs([asked])
    assert told.value.exit_code == 2
    assert told.value.todo


def test_the_options_of_a_store_stay_with_each_log(tmp_path, monkeypatch):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/a.mcap").touch()
    store = fs.SubTreeFileSystem(str(tmp_path), fs.LocalFileSystem())
    opened = []
    monkeypatch.setattr(inputs, "open_address", lambda address: opened.append(address) or (store, "logs"))
    assert find_logs(["s3://bucket/logs/*.mcap?region=x"]) == ["s3://bucket/logs/a.mcap?region=x"]
    assert opened == ["s3://bucket/logs?region=x"]
