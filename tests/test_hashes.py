import hashlib
import json
import os
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline import hashes as module
from maglev_offline.hashes import SETTLED_COARSE_NS, SETTLED_NS, KnownHashes, Stamp, settled, sha256_of, stamp_of


@pytest.fixture
def cache(tmp_path):
    return tmp_path / "workspace" / ".known_hashes.json"


@pytest.fixture
def log(tmp_path, cache):
    """A file that was left alone for long enough."""
    cache.parent.mkdir()
    path = tmp_path / "log.mcap"
    path.write_bytes(b"abc")
    time.sleep(SETTLED_NS / 1e9 + 0.02)
    return path


@pytest.fixture
def reads(monkeypatch):
    """Names of the files that were read to hash them."""
    found = []
    monkeypatch.setattr(module, "sha256_of", lambda path: found.append(path.name) or sha256_of(path))
    return found


def hashed(cache, path, **options):
    known = KnownHashes(cache, **options)
    found = known.sha256(path)
    known.save()
    return found


def test_a_file_that_was_not_touched_is_read_once(cache, log, reads):
    for _ in range(3):
        assert hashed(cache, log) == hashlib.sha256(b"abc").hexdigest()
    assert reads == ["log.mcap"]


def test_a_file_is_the_same_by_whatever_name_it_is_called(cache, log, reads, monkeypatch):
    hashed(cache, log)
    monkeypatch.chdir(log.parent)
    hashed(cache, log.relative_to(log.parent))
    hashed(cache, log.parent / "workspace/../log.mcap")
    assert reads == ["log.mcap"]


def append(path):
    with path.open("ab") as file:
        file.write(b"d")


def overwrite(path):
    path.write_bytes(b"abd")


def overwrite_and_set_the_time_back(path):
    before = path.stat()
    path.write_bytes(b"abd")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def replace(path):
    before = path.stat()
    other = path.with_name("other")
    other.write_bytes(b"abd")
    os.utime(other, ns=(before.st_atime_ns, before.st_mtime_ns))
    other.replace(path)


@pytest.mark.parametrize("change", [append, overwrite, overwrite_and_set_the_time_back, replace])
def test_a_file_that_was_changed_is_read_again(cache, log, change):
    before = hashed(cache, log)
    change(log)
    assert hashed(cache, log) == sha256_of(log) != before


def test_a_file_that_was_written_just_now_is_not_trusted_the_next_time(cache, log, reads):
    overwrite(log)
    hashed(cache, log)
    hashed(cache, log)
    assert reads == ["log.mcap"] * 2


@pytest.mark.parametrize(
    ("stamp", "age_ns", "trusted"),
    [
        (Stamp(1, 10**18 + 5, 10**18 + 5, 1), SETTLED_NS, False),
        (Stamp(1, 10**18 + 5, 10**18 + 5, 1), SETTLED_NS + 1, True),
        (Stamp(1, 10**18, 10**18, 1), SETTLED_NS + 1, False),
        (Stamp(1, 10**18, 10**18, 1), SETTLED_COARSE_NS + 1, True),
        (Stamp(1, 10**18 + 5, 10**18 + 5, 1), -1, False),
    ],
)
def test_a_file_must_have_been_left_alone_for_longer_than_its_clock_ticks(stamp, age_ns, trusted):
    assert settled(stamp, stamp.changed_ns + age_ns) == trusted


def test_distrust_reads_every_file_and_keeps_what_it_found(cache, log, reads):
    hashed(cache, log)
    data = json.loads(cache.read_text())
    data["files"][str(log)][-1] = "0" * 64
    cache.write_text(json.dumps(data))
    assert hashed(cache, log) == "0" * 64
    assert hashed(cache, log, distrust=True) == hashed(cache, log) == sha256_of(log)
    assert reads == ["log.mcap"] * 2


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"version": 1}',
        '{"version": 99, "files": {}}',
        '{"version": 1, "files": []}',
        "\xff\xfe",
    ],
)
def test_a_cache_that_is_damaged_is_made_again(cache, log, text, reads):
    cache.write_bytes(text.encode("latin-1"))
    assert hashed(cache, log) == hashed(cache, log) == sha256_of(log)
    assert reads == ["log.mcap"]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5), lambda x: st.lists(x, max_size=5)
)


@given(json_values)
def test_a_damaged_entry_is_ignored(tmp_path_factory, value):
    cache = tmp_path_factory.mktemp("cache") / "known.json"
    cache.write_text(json.dumps({"version": 1, "files": {"/log": value}}))
    known = KnownHashes(cache)
    assert known.recall("/log", Stamp(1, 2, 3, 4)) is None


def test_a_cache_is_written_whole_or_not_at_all(cache, log, monkeypatch):
    hashed(cache, log)
    before = cache.read_bytes()
    append(log)
    time.sleep(SETTLED_NS / 1e9 + 0.02)

    def fail(self, target):
        raise OSError("no space")

    monkeypatch.setattr(type(cache), "replace", fail)
    hashed(cache, log)
    assert cache.read_bytes() == before
    assert [p.name for p in cache.parent.iterdir()] == [cache.name]


def test_a_run_that_learned_nothing_writes_nothing(cache, log):
    hashed(cache, log)
    before = stamp_of(cache)
    hashed(cache, log)
    assert stamp_of(cache) == before


def test_files_that_are_gone_are_forgotten_and_objects_elsewhere_are_not(cache, log, tmp_path):
    known = KnownHashes(cache)
    known.keep(str(tmp_path / "gone.mcap"), Stamp(1, 2, 3, 4), "1" * 64)
    known.keep("s3://bucket/a.mcap", Stamp(1, 2), "2" * 64)
    known.save()
    again = KnownHashes(cache)
    assert again.recall(str(tmp_path / "gone.mcap"), Stamp(1, 2, 3, 4)) is None
    assert again.recall("s3://bucket/a.mcap", Stamp(1, 2)) == "2" * 64


def test_a_file_that_is_not_there_is_told_as_it_is(cache, tmp_path):
    with pytest.raises(FileNotFoundError):
        KnownHashes(cache).sha256(tmp_path / "none.mcap")
