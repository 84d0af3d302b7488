"""A chunk is used whole or not at all, and what is not used is told with its count."""

import struct
import zlib

import lz4.frame
import pytest
import zstandard

from maglev_offline.logs.chunks import load_span
from maglev_offline.logs.source import Source
from maglev_offline.logs.structure import ChunkSpan

COMPRESSIONS = ["zstd", "lz4", "none"]


@pytest.fixture
def log(containers, tmp_path):
    """A path and its messages, with a damaged copy to be read."""

    class Log:
        made = containers.messages(2000)
        path = tmp_path / "a.mcap"

        def write(self, **options):
            containers.write(self.path, self.made, **options)
            self.chunk = containers.chunk_indexes(self.path)[3]
            self.at = self.chunk.chunk_start_offset
            whole = containers.read(self.path)
            with_lengths = [len(self.loaded(span)) for span in whole.structure.spans]
            self.first = sum(with_lengths[:3])
            self.in_chunk = with_lengths[3]
            return self

        def loaded(self, span):
            data = self.path.read_bytes()
            source = Source("a", len(data), True, lambda offset, length: data[offset : offset + length])
            return load_span(source, span).messages

        @property
        def without_chunk(self):
            return self.made[: self.first] + self.made[self.first + self.in_chunk :]

    return Log()


def loaded_from(record, index=b""):
    """What comes out of a file that holds this chunk record alone."""
    content = record + index
    source = Source("a", len(content), True, lambda offset, length: content[offset : offset + length])
    return load_span(source, ChunkSpan(0, len(record), len(record), len(index)))


def chunk(stored, size, compression, crc=0):
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 0, size, crc, len(name)) + name + struct.pack("<Q", len(stored)) + stored
    return struct.pack("<BQ", 6, len(body)) + body


def messages_of(n):
    return b"".join(struct.pack("<BQHIQQ", 5, 30, 1, k, k, k) + bytes(8) for k in range(n))


class TestDamagedContent:
    @pytest.mark.parametrize("compression", COMPRESSIONS)
    @pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.9])
    def test_a_flipped_byte_costs_its_chunk_and_no_other(self, containers, log, compression, share):
        log.write(compression=compression)
        containers.flip(log.path, log.at + 60 + int((log.chunk.chunk_length - 61) * share))
        read = containers.read(log.path)
        assert read.messages == log.without_chunk
        assert read.lost == log.in_chunk
        assert read.missing == 0
        (damage,) = read.damages
        assert damage.code in ("chunk_crc_mismatch", "chunk_unreadable", "chunk_size_mismatch")
        assert compression != "none" or damage.code == "chunk_crc_mismatch"
        assert (damage.offset, damage.length) == (log.at, log.chunk.chunk_length)

    def test_what_is_lost_is_known_without_an_index_too_where_the_records_can_be_followed(self, containers, log):
        from mcap.writer import IndexType

        log.write(compression="none", index_types=IndexType.CHUNK)
        containers.flip(log.path, log.at + 60 + 31 + 4)  # within a payload
        read = containers.read(log.path)
        assert read.codes == ["chunk_crc_mismatch"]
        assert read.lost == log.in_chunk
        assert read.messages == log.without_chunk

    def test_what_is_lost_is_unknown_where_neither_tells(self, containers, log):
        from mcap.writer import IndexType

        log.write(compression="zstd", index_types=IndexType.CHUNK)
        containers.flip(log.path, log.at + log.chunk.chunk_length - 200)
        read = containers.read(log.path)
        assert read.damages[0].messages is None
        assert sum(read.short.in_damage.values()) == log.in_chunk

    def test_a_flipped_record_length_costs_nothing(self, containers, log):
        log.write()
        containers.flip(log.path, log.at + 2)
        read = containers.read(log.path)
        assert read.codes == ["record_length_mismatch"]
        assert read.messages == log.made

    @pytest.mark.parametrize("summary", [True, False])
    def test_an_unknown_compression(self, containers, log, summary):
        log.write()
        containers.damage(log.path, log.at + 9 + 32, b"lzma")
        if not summary:
            containers.without_summary(log.path)
        read = containers.read(log.path)
        assert [code for code in read.codes if code != "no_footer"] == ["unknown_compression"]
        assert "'lzma'" in read.damages[-1].detail
        assert read.lost == log.in_chunk
        assert read.messages == log.without_chunk

    @pytest.mark.parametrize("compression", COMPRESSIONS)
    @pytest.mark.parametrize("claimed", [100 * 10**9, 2**31 + 1, 2**63])
    def test_a_chunk_that_claims_100_gb_takes_no_memory(self, containers, log, compression, claimed):
        log.write(compression=compression)
        containers.damage(log.path, log.at + 9 + 16, struct.pack("<Q", claimed))
        read = containers.read(log.path)
        assert read.codes == ["chunk_too_large"]
        assert read.lost == log.in_chunk
        assert read.messages == log.without_chunk

    @pytest.mark.parametrize("compression", COMPRESSIONS)
    @pytest.mark.parametrize("by", [-1, 1, 1000])
    def test_a_chunk_that_holds_more_or_less_than_it_claims(self, containers, log, compression, by):
        log.write(compression=compression)
        containers.damage(log.path, log.at + 9 + 16, struct.pack("<Q", log.chunk.uncompressed_size + by))
        read = containers.read(log.path)
        assert read.codes == ["chunk_size_mismatch"]
        assert read.messages == log.without_chunk


class TestIndex:
    def test_a_wrong_index_is_told_and_costs_nothing(self, containers, log):
        log.write()
        containers.flip(log.path, log.at + log.chunk.chunk_length + 15 + 8)
        read = containers.read(log.path)
        assert read.codes == ["message_index_mismatch"]
        assert read.lost == 0
        assert read.messages == log.made

    def test_an_index_of_zeros_too(self, containers, log):
        log.write()
        at = log.at + log.chunk.chunk_length
        containers.damage(log.path, at, bytes(log.chunk.message_index_length))
        read = containers.read(log.path)
        assert read.codes == ["message_index_mismatch"]
        assert read.messages == log.made


class TestBounds:
    """Chunks made by hand."""

    @pytest.mark.parametrize("content", [b"", messages_of(1), messages_of(5000)])
    def test_frames_that_do_not_tell_their_size(self, content):
        frames = {
            "zstd": zstandard.ZstdCompressor(write_content_size=False).compress(content),
            "lz4": lz4.frame.compress(content, store_size=False),
        }
        for name, stored in frames.items():
            loaded = loaded_from(chunk(stored, len(content), name, zlib.crc32(content)))
            assert loaded.damages == ()
            assert loaded.data.tobytes() == content
            assert len(loaded.messages) == len(content) // 39

    def test_two_zstd_frames_in_one_chunk(self):
        content = messages_of(200)
        stored = zstandard.compress(content[:100]) + zstandard.compress(content[100:])
        assert len(loaded_from(chunk(stored, len(content), "zstd", zlib.crc32(content))).messages) == 200

    @pytest.mark.parametrize("name", ["zstd", "lz4"])
    def test_a_bomb_is_stopped_at_what_it_claims(self, name):
        bomb = bytes(2**24)
        stored = {
            "zstd": zstandard.ZstdCompressor(write_content_size=False).compress(bomb),
            "lz4": lz4.frame.compress(bomb, store_size=False),
        }[name]
        (damage,) = loaded_from(chunk(stored, 1000, name)).damages
        assert damage.code == "chunk_size_mismatch"
        assert damage.messages is None

    @pytest.mark.parametrize("name", ["zstd", "lz4"])
    @pytest.mark.parametrize("stored", [b"", b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18", bytes(100), b"\xff" * 100])
    def test_what_is_no_frame(self, name, stored):
        (damage,) = loaded_from(chunk(stored, 1000, name)).damages
        assert damage.code in ("chunk_unreadable", "chunk_size_mismatch", "chunk_too_large")

    @pytest.mark.parametrize("name", ["zstd", "lz4"])
    def test_a_frame_that_is_cut_off(self, name):
        content = messages_of(5000)
        stored = zstandard.compress(content) if name == "zstd" else lz4.frame.compress(content)
        for cut in (1, 3, len(stored) // 2, len(stored) - 4):
            (damage,) = loaded_from(chunk(stored[:-cut], len(content), name)).damages
            assert damage.code in ("chunk_unreadable", "chunk_size_mismatch", "chunk_too_large")

    def test_a_chunk_whose_records_break_off_gives_those_before(self):
        content = messages_of(10) + bytes(50)
        loaded = loaded_from(chunk(content, len(content), ""))
        assert len(loaded.messages) == 10
        (damage,) = loaded.damages
        assert damage.code == "records_unreadable"
        assert damage.messages is None

    def test_without_a_check_sum_it_is_taken_as_it_is(self):
        content = messages_of(10)
        assert loaded_from(chunk(content, len(content), "")).damages == ()

    def test_every_record_that_is_cut_off(self):
        content = messages_of(10)
        whole = chunk(content, len(content), "")
        for length in range(len(whole)):
            (damage,) = loaded_from(whole[:length]).damages
            assert damage.code == "chunk_unreadable"
