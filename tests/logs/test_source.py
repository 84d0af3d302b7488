"""A log may lie anywhere; what cannot be a log is told in plain words."""

import hashlib

import pytest

from maglev_offline.errors import LogError
from maglev_offline.logs.source import is_uri, open_source


def refused(where):
    with pytest.raises(LogError) as found, open_source(where):
        pass
    assert found.value.todo
    return found.value.what


class TestLocal:
    def test_a_stretch_is_short_at_the_end_of_the_file_and_empty_behind_it(self, containers, tmp_path):
        path = containers.write(tmp_path / "a.mcap", containers.messages(10))
        whole = path.read_bytes()
        with open_source(path) as source:
            assert source.name == str(path)
            assert source.size == len(whole)
            assert source.read_at(3, 10) == whole[3:13]
            assert source.read_at(len(whole) - 4, 10) == whole[-4:]
            assert source.read_at(len(whole), 10) == b""
            assert source.read_at(2**62, 2**62) == b""

    def test_its_hash(self, containers, tmp_path):
        path = containers.write(tmp_path / "a.mcap", containers.messages(10))
        with open_source(str(path)) as source:
            assert source.sha256() == hashlib.sha256(path.read_bytes()).hexdigest()

    def test_a_file_that_is_not_there(self, tmp_path):
        assert "cannot be opened" in refused(tmp_path / "none.mcap")
        assert "cannot be opened" in refused("a\0b.mcap")

    def test_a_folder(self, tmp_path):
        assert "folder" in refused(tmp_path)

    def test_an_empty_file(self, tmp_path):
        (tmp_path / "a.mcap").touch()
        assert "0 bytes" in refused(tmp_path / "a.mcap")

    @pytest.mark.parametrize("content", [b"t,gap\n0,8\n", b"\x89", b"\x89MCAP1\r\n" * 4])
    def test_no_mcap_at_all(self, tmp_path, content):
        (tmp_path / "a.mcap").write_bytes(content)
        assert "not an MCAP file" in refused(tmp_path / "a.mcap")

    @pytest.mark.parametrize(
        ("name", "content", "todo"),
        [
            ("a.bag", b"#ROSBAG V2.0\n", "mcap convert"),
            ("a.zip", b"PK\x03\x04", "unpack it"),
            ("a.toml", b"[signals]\n", "give it with --recipe"),
            ("a.csv", b"t,gap\n", "convert the log to MCAP"),
        ],
    )
    def test_what_to_do_with_another_file(self, tmp_path, name, content, todo):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(LogError) as found:
            open_source(tmp_path / name).__enter__()
        assert todo in found.value.todo

    def test_a_disk_that_fails(self, containers, tmp_path, monkeypatch):
        path = containers.write(tmp_path / "a.mcap", containers.messages(10))

        def fail(*_):
            raise OSError(5, "Input/output error")

        with open_source(path) as source:
            monkeypatch.setattr("os.pread", fail)
            with pytest.raises(LogError, match=r"byte 7 .*Input/output error"):
                source.read_at(7, 1)


class TestUri:
    def test_what_is_one(self, tmp_path):
        assert is_uri("s3://bucket/a.mcap")
        assert is_uri("file:///a.mcap")
        assert not is_uri("a.mcap")
        assert not is_uri(tmp_path)

    def test_it_reads_as_the_local_file_does(self, containers, tmp_path):
        made = containers.messages(500)
        path = containers.write(tmp_path / "a.mcap", made)
        assert containers.read(path.as_uri()) == containers.read(path)
        assert containers.read(path.as_uri()).messages == made

    def test_what_is_not_there_or_a_folder(self, tmp_path):
        assert "cannot be opened" in refused((tmp_path / "none.mcap").as_uri())
        assert "folder" in refused(tmp_path.as_uri())
        assert "cannot be opened" in refused("nonsense://x/y.mcap")
        assert "cannot be opened" in refused("mock:///none.mcap")
