import os
import sys
from pathlib import Path

import pytest

from maglev_offline.errors import InputError
from maglev_offline.filesystems import (
    below,
    in_words,
    is_address,
    local_path,
    name_of,
    open_address,
    shown,
    write_whole,
)


@pytest.mark.parametrize("text", ["s3://b/k", "file:///a", "gs://b", "abfs://c@a/x", "memory://x"])
def test_an_address_has_a_scheme(text):
    assert is_address(text)


@pytest.mark.parametrize("text", ["logs/a.mcap", "/a", "C:/a", "c://a", "a:b", "run[1]/x://y", "", "://a"])
def test_a_path_is_no_address(text):
    assert not is_address(text)


@pytest.mark.parametrize(
    ("address", "path"),
    [
        ("file:///data/a.mcap", "/data/a.mcap"),
        ("file://localhost/data", "/data"),
        ("file:///a%20b/*.mcap", "/a b/*.mcap"),
        ("FILE:///a", "/a"),
    ],
)
def test_a_file_address_is_a_path(address, path):
    assert local_path(address) == Path(path)
    assert local_path("s3://bucket/a") is None


@pytest.mark.parametrize("address", ["file://host/a", "file://a", "file://"])
def test_a_file_address_of_another_machine_is_refused(address):
    with pytest.raises(InputError, match="three slashes"):
        local_path(address)


def test_nobody_is_shown_a_key_or_an_option():
    assert shown("s3://KEY:secret@bucket/a.mcap?token=x") == "s3://bucket/a.mcap"
    assert shown("s3://KEY:sec/r@t@bucket/a.mcap") == "s3://bucket/a.mcap"
    assert shown("abfs://container@account/a.mcap") == "abfs://container@account/a.mcap"
    assert shown(Path("a/b")) == "a/b"
    with pytest.raises(InputError) as told, in_words("s3://KEY:secret@bucket/a"):
        raise OSError("cannot open s3://KEY:secret@bucket/a")
    assert "secret" not in str(told.value)


def test_a_name_is_the_last_part():
    assert name_of(Path("a/b.mcap")) == "b.mcap"
    assert name_of("s3://bucket/logs/a%20b.mcap?region=x") == "a b.mcap"


def test_options_stay_behind_the_path():
    assert below("s3://bucket/logs/", "a.mcap") == "s3://bucket/logs/a.mcap"
    assert below("s3://bucket/logs?region=x", "a.mcap") == "s3://bucket/logs/a.mcap?region=x"


@pytest.mark.parametrize("address", ["foo://x/y", "memory::s3://x/y", "nonsense+x://"])
def test_an_address_of_an_unknown_kind_is_told_of(address):
    with pytest.raises(InputError, match=r"nothing here that opens|cannot be used"):
        open_address(address)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (FileNotFoundError(2, "x"), "it is not there"),
        (OSError("AWS Error NO_SUCH_BUCKET during HeadBucket: nothing"), "there is no such bucket"),
        (OSError("AWS Error ACCESS_DENIED during ListObjectsV2"), "refuses access"),
        (OSError("Failed to get token from DefaultAzureCredential"), "refuses access"),
        (OSError("AWS Error NETWORK_CONNECTION: Could not resolve host"), "cannot be reached"),
        (OSError("Path does not exist 'bucket/a'"), "it is not there"),
        (ImportError("Install s3fs to access S3"), r"cannot be used \(Install s3fs"),
        (RuntimeError("\n"), r"cannot be used \(RuntimeError\)"),
        (OSError("first line\n" + "dlopen failed\n" * 900), r"cannot be used \(first line\)\. Check"),
    ],
)
def test_the_failure_of_a_store_is_told_in_plain_words(error, words):
    with pytest.raises(InputError, match=words) as told, in_words("s3://bucket/a"):
        raise error
    assert told.value.exit_code == 2
    assert len(str(told.value)) < 500


def test_an_error_that_is_told_already_stays_as_it_is():
    with pytest.raises(InputError, match=r"^here: mine$"), in_words("s3://bucket"):
        raise InputError("mine", where="here")


def test_a_local_path_needs_no_file_system(tmp_path):
    import subprocess

    code = f"""
import os
import sys
from maglev_offline.ingest.inputs import find_logs
find_logs([{str(tmp_path / "a.mcap")!r}, {"file://" + str(tmp_path / "b.mcap")!r}])
print([name for name in sys.modules if name.split(".")[0] in ("pyarrow", "fsspec", "numpy", "pandas")])
"""
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_a_file_written_whole_follows_a_link_keeps_its_mode_and_leaves_no_draft(tmp_path):
    there, link = tmp_path / "there", tmp_path / "link"
    there.write_text("old")
    there.chmod(0o640)
    link.symlink_to(there)
    write_whole(link, b"new")
    assert link.is_symlink()
    assert there.read_text() == "new"
    assert there.stat().st_mode & 0o777 == 0o640
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "there"]


def test_what_is_no_file_is_written_into(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(pipe, b"page")
        assert os.read(reading, 9) == b"page"
    finally:
        os.close(reading)
    assert not pipe.is_file()
