import os
import time

import pytest
from pyarrow import fs

from maglev_offline.errors import InputError, LogError
from maglev_offline.hashes import SETTLED_COARSE_NS, SETTLED_NS, KnownHashes, sha256_of
from maglev_offline.ingest import known_logs
from maglev_offline.ingest.known_logs import at_hand, hash_of_log, recall

ADDRESS = "s3://bucket/a.mcap"


@pytest.fixture
def bucket(tmp_path, monkeypatch):
    """Folder that stands for the bucket: pyarrow's own file system, so that times are told as S3 tells them."""
    folder = tmp_path / "bucket"
    folder.mkdir()
    (folder / "a.mcap").write_bytes(b"abc")
    old = time.time_ns() - 10 * SETTLED_COARSE_NS
    os.utime(folder / "a.mcap", ns=(old, old))
    opened = []

    def open_address(address):
        opened.append(address)
        return fs.SubTreeFileSystem(str(folder), fs.LocalFileSystem()), address.removeprefix("s3://bucket/")

    monkeypatch.setattr(known_logs, "open_address", open_address)
    return folder


@pytest.fixture
def blocks(monkeypatch):
    """Addresses of the logs that were read."""
    found, read = [], known_logs._blocks
    monkeypatch.setattr(known_logs, "_blocks", lambda address: found.append(address) or read(address))
    return found


@pytest.fixture
def known(tmp_path):
    return KnownHashes(tmp_path / "known.json")


def test_a_log_in_a_store_is_read_once(bucket, known, blocks):
    assert recall(ADDRESS, known) is None
    for _ in range(2):
        assert hash_of_log(ADDRESS, known) == sha256_of(bucket / "a.mcap")
    known.save()
    assert recall(ADDRESS, KnownHashes(known.path)) == sha256_of(bucket / "a.mcap")
    assert recall(ADDRESS, KnownHashes(known.path, distrust=True)) is None
    assert blocks == [ADDRESS]


def test_a_log_in_a_store_that_has_changed_is_read_again(bucket, known):
    before = hash_of_log(ADDRESS, known)
    (bucket / "a.mcap").write_bytes(b"abd")
    assert recall(ADDRESS, known) is None
    assert hash_of_log(ADDRESS, known) == sha256_of(bucket / "a.mcap") != before


def test_a_local_log_is_read_once(bucket, known, tmp_path):
    path = bucket / "a.mcap"
    path.touch()
    time.sleep(SETTLED_NS / 1e9 + 0.02)
    assert recall(path, known) is None
    assert hash_of_log(path, known) == recall(path, known) == sha256_of(path)


def test_a_store_that_tells_no_time_is_never_trusted(known):
    store = pytest.importorskip("fsspec").filesystem("memory")
    store.pipe("/bucket/a.mcap", b"abc")
    address = "memory://bucket/a.mcap"
    hash_of_log(address, known)
    assert recall(address, known) is None
    store.rm("/bucket", recursive=True)


@pytest.mark.usefixtures("bucket")
@pytest.mark.parametrize("where", ["s3://bucket/none.mcap", "path"])
def test_a_log_that_is_not_there_is_refused_like_any_other(where, known, tmp_path):
    where = tmp_path / "none.mcap" if where == "path" else where
    assert recall(where, known) is None
    with pytest.raises(LogError, match=r"none\.mcap: (the log cannot be opened|it is not there)"):
        hash_of_log(where, known)


def test_a_store_that_fails_is_told_of_as_a_log_that_cannot_be_used(known, monkeypatch):
    def fail(address):
        raise InputError("the store cannot be reached.", where=address)

    monkeypatch.setattr(known_logs, "open_address", fail)
    assert recall(ADDRESS, known) is None
    with pytest.raises(LogError, match="cannot be reached"):
        hash_of_log(ADDRESS, known)


def test_a_log_in_a_store_is_at_hand_for_as_long_as_it_is_needed(bucket, tmp_path):
    sha256 = sha256_of(bucket / "a.mcap")
    with at_hand(ADDRESS, tmp_path / "incoming", sha256) as path:
        assert path.read_bytes() == b"abc"
        assert path.is_relative_to(tmp_path / "incoming")
        assert path.suffix == ".mcap"
    assert list((tmp_path / "incoming").iterdir()) == []


def test_a_local_log_is_at_hand_where_it_lies(bucket, tmp_path):
    with at_hand(bucket / "a.mcap", tmp_path / "incoming", "") as path:
        assert path == bucket / "a.mcap"
    assert not (tmp_path / "incoming").exists()


@pytest.mark.usefixtures("bucket")
def test_a_log_that_changed_between_two_reads_is_refused(tmp_path):
    with pytest.raises(LogError, match="has changed while it was read"), at_hand(ADDRESS, tmp_path, "0" * 64):
        pass
    assert not list(tmp_path.glob("log-*"))
