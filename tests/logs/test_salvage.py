"""Damaged files: what is saved, to the message, and what is lost, to the message or as far as anything tells."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import IndexType

from maglev_offline.logs.structure import ChunkSpan

N = 6000
COMPRESSIONS = ["zstd", "lz4", "none"]


@pytest.fixture
def log(containers, tmp_path):
    """Writes the same messages each time."""

    class Log:
        made = containers.messages(N)
        path = tmp_path / "a.mcap"

        def write(self, **options):
            containers.write(self.path, self.made, **options)
            self.whole = self.path.read_bytes()
            return self

        def read(self, content):
            self.path.write_bytes(content)
            return containers.read(self.path)

    return Log()


def is_part_of(found, made):
    """Whether these are messages that were written, in their order, none twice."""
    left = iter(made)
    return all(any(m == other for other in left) for m in found)


class TestTruncated:
    @pytest.mark.parametrize("compression", COMPRESSIONS)
    @pytest.mark.parametrize("share", [0.1, 0.7, 0.95])
    def test_all_whole_chunks_are_saved(self, containers, log, compression, share):
        log.write(compression=compression)
        cut = int(len(log.whole) * share)
        ends = [c.chunk_start_offset + c.chunk_length for c in containers.chunk_indexes(log.path)]
        kept = sum(end <= cut for end in ends)
        per_chunk = len(containers.read(log.path).messages)
        read = log.read(log.whole[:cut])
        assert len(read.structure.spans) == kept
        assert read.messages == log.made[: len(read.messages)]
        assert 0 < len(read.messages) <= per_chunk
        assert set(read.codes) <= {"truncated", "no_footer", "message_index_mismatch"}
        assert ("truncated" in read.codes) or ("no_footer" in read.codes)
        assert not read.structure.whole
        assert read.structure.channels.keys() == {1, 2, 3}

    @pytest.mark.parametrize("share", [0.1, 0.7, 0.95])
    def test_all_whole_loose_messages_are_saved(self, log, share):
        log.write(chunked=False)
        cut = int(len(log.whole) * share)
        read = log.read(log.whole[:cut])
        size, expected = log.whole.index(log.made[0].payload) - 31, 0
        for m in log.made:
            size += 31 + len(m.payload)
            expected += size <= cut
        assert read.messages == log.made[:expected]
        (damage,) = read.damages
        assert damage.code in ("truncated", "no_footer")
        assert damage.messages is None

    def test_at_the_end_of_the_data_section_nothing_is_lost(self, containers, log):
        log.write()
        containers.without_summary(log.path)
        read = containers.read(log.path)
        assert read.codes == ["no_footer"]
        assert read.messages == log.made

    def test_within_the_summary_nothing_is_lost_and_that_is_known(self, log):
        log.write()
        for cut in (1, 8, 20, 37, 100):
            read = log.read(log.whole[:-cut])
            assert read.messages == log.made
            assert read.codes in (["truncated"], ["no_footer"])
            assert read.damages[0].messages == {}

    def test_only_the_magic_bytes(self, log):
        log.write()
        read = log.read(log.whole[:8])
        assert read.codes == ["no_footer"]
        assert read.messages == []


class TestBehindTheEnd:
    @pytest.mark.parametrize("chunked", [True, False])
    @pytest.mark.parametrize("tail", [bytes(1), bytes(50_000), b"\xff" * 5000])
    def test_trailing_bytes_cost_nothing(self, log, chunked, tail):
        log.write(chunked=chunked)
        read = log.read(log.whole + tail)
        assert read.messages == log.made
        assert read.codes == ["trailing_bytes"]
        assert read.damages[0].messages == {}
        assert (read.damages[0].offset, read.damages[0].length) == (len(log.whole), len(tail))
        assert sum(read.structure.claimed.values()) == N

    def test_a_second_log_behind_the_first_is_told(self, log):
        log.write()
        read = log.read(log.whole * 2)
        assert read.messages == log.made
        assert read.codes == ["trailing_bytes"]
        assert "another MCAP file" in read.damages[0].detail


class TestHoles:
    @pytest.mark.parametrize("compression", COMPRESSIONS)
    @pytest.mark.parametrize("summary", [True, False])
    def test_a_hole_of_zeros_costs_the_chunks_that_it_touches(self, containers, log, compression, summary):
        log.write(compression=compression)
        first, last = len(log.whole) // 3, len(log.whole) // 3 + 20_000
        indexes = containers.chunk_indexes(log.path)
        touched = [i.chunk_start_offset < last and i.chunk_start_offset + i.chunk_length > first for i in indexes]
        content = log.whole[:first] + bytes(last - first) + log.whole[last:]
        read = log.read(content if summary else content[:-37])
        assert is_part_of(read.messages, log.made)
        saved = sum(not t for t in touched)
        assert sum(touched) >= 2
        assert len(read.structure.spans) >= saved
        if summary:
            assert len(read.messages) + read.lost + read.missing == N
        assert N - len(read.messages) <= sum(touched) * N / len(indexes) * 1.2
        assert read.messages[0] == log.made[0]
        assert read.messages[-1] == log.made[-1]

    @pytest.mark.parametrize("summary", [True, False])
    def test_in_an_unchunked_file_it_costs_the_messages_in_it_and_the_one_before(self, log, summary):
        log.write(chunked=False)
        first, last = 100_000, 120_000
        content = log.whole[:first] + bytes(last - first) + log.whole[last:]
        read = log.read(content if summary else content[:-37])
        size, kept, before = log.whole.index(log.made[0].payload) - 31, [], []
        for m in log.made:
            end = size + 31 + len(m.payload)
            if end <= first:
                before.append(m)
            elif size >= last:
                kept.append(m)
            size = end
        assert read.messages in (before[:-1] + kept, before + kept)
        (hole,) = [damage for damage in read.damages if damage.code == "bytes_unreadable"]
        assert hole.messages is None
        assert not summary or sum(read.short.in_damage.values()) == N - len(read.messages)

    def test_bytes_that_are_gone_cost_the_chunk_that_they_are_gone_from(self, containers, log):
        log.write()
        at = containers.chunk_indexes(log.path)[5].chunk_start_offset
        read = log.read(log.whole[: at + 500] + log.whole[at + 777 :])
        assert "bytes_unreadable" in read.codes
        assert is_part_of(read.messages, log.made)
        assert len(read.messages) > N * 0.97
        assert len(read.messages) + sum(read.short.in_damage.values()) == N

    def test_bytes_that_were_put_in_between_records_cost_nothing(self, containers, log):
        log.write()
        at = containers.chunk_indexes(log.path)[5].chunk_start_offset
        read = log.read(log.whole[:at] + b"\xff" * 300 + log.whole[at:])
        assert read.messages == log.made
        assert [(d.offset, d.length) for d in read.damages if d.code == "bytes_unreadable"] == [(at, 300)]

    @pytest.mark.parametrize("number", [0, 5])
    def test_the_messages_of_a_broken_uncompressed_chunk_are_not_taken_for_loose_ones(self, containers, log, number):
        log.write(compression="none")
        chunk = containers.chunk_indexes(log.path)[number]
        content = bytearray(log.whole[:-37])
        content[chunk.chunk_start_offset : chunk.chunk_start_offset + 60] = bytes(60)
        read = log.read(bytes(content))
        assert "bytes_unreadable" in read.codes
        assert all(isinstance(span, ChunkSpan) for span in read.structure.spans)
        assert is_part_of(read.messages, log.made)
        if number == 0:
            # The writer declares its channels in the first chunk alone.
            assert read.messages == []
            assert set(read.codes) == {"bytes_unreadable", "no_footer", "unknown_channel"}
            assert read.lost > N * 0.95
        else:
            assert N * 0.95 < len(read.messages) < N

    @pytest.mark.parametrize("byte", [1, 3, 7])
    def test_a_flipped_record_length_costs_no_chunk(self, containers, log, byte):
        log.write()
        at = containers.chunk_indexes(log.path)[5].chunk_start_offset
        content = bytearray(log.whole)
        content[at + byte] ^= 0xFF
        for part in (content, content[:-37]):
            read = log.read(bytes(part))
            assert read.messages == log.made
            assert "record_length_mismatch" in read.codes

    def test_a_flipped_record_length_of_a_loose_message_costs_that_one(self, log):
        log.write(chunked=False)
        content = bytearray(log.whole)
        content[log.whole.index(log.made[99].payload) - 29] ^= 0xFF
        read = log.read(bytes(content))
        assert read.messages == log.made[:99] + log.made[100:]
        assert read.codes == ["bytes_unreadable"]
        assert sum(read.short.in_damage.values()) == 1


class TestWhereChunksAreNotTold:
    """Messages outside chunks are looked for only where it is known that there are no chunks."""

    def test_in_a_whole_file_whose_start_is_broken(self, containers, log):
        log.write(chunked=False)
        read = containers.read_content(log.whole[:9] + b"\xff" * 8 + log.whole[17:])
        assert read.messages == log.made

    def test_not_in_a_file_of_one_uncompressed_chunk_that_is_cut_off(self, containers, log):
        log.write(compression="none", chunk_size=2**20)
        whole = containers.read_content(log.whole)
        for broken in (0, 1):
            start = whole.structure.spans[0].offset
            content = log.whole[:start] + bytes(9 * broken) + log.whole[start + 9 * broken : 100_000]
            read = containers.read_content(content)
            assert read.messages == []
            assert read.codes == ["truncated"]
            assert read.damages[0].messages is None


class TestDataCheckSum:
    def test_a_flipped_payload_byte_in_an_unchunked_file_is_not_delivered(self, containers, log):
        log.write(chunked=False, enable_data_crcs=True)
        assert containers.read(log.path).messages == log.made
        containers.flip(log.path, log.whole.index(log.made[2000].payload) + 3)
        read = containers.read(log.path)
        assert read.codes == ["data_crc_mismatch"]
        assert read.messages == []
        assert read.damages[0].messages == {1: N // 3, 2: N // 3, 3: N // 3}
        assert read.missing == 0


class TestNothingIsInvented:
    @pytest.mark.parametrize("compression", COMPRESSIONS)
    def test_every_third_byte_flipped(self, containers, tmp_path, compression):
        made = containers.messages(25)
        path = containers.write(tmp_path / "a.mcap", made, compression=compression, chunk_size=400)
        whole = path.read_bytes()
        for k in range(9, len(whole), 3):
            read = containers.read_content(whole[:k] + bytes([whole[k] ^ 0xFF]) + whole[k + 1 :])
            assert is_part_of(read.messages, made), k
            assert len(read.messages) + read.lost <= len(made), k
            assert read.damages or read.messages == made, k

    @pytest.mark.parametrize("data_crc", [True, False])
    def test_every_third_byte_flipped_of_an_unchunked_file(self, containers, tmp_path, data_crc):
        made = containers.messages(25)
        path = containers.write(tmp_path / "a.mcap", made, chunked=False, enable_data_crcs=data_crc)
        whole = path.read_bytes()
        for k in range(9, len(whole), 3):
            read = containers.read_content(whole[:k] + bytes([whole[k] ^ 0xFF]) + whole[k + 1 :])
            assert len(read.messages) + read.lost <= len(made), k
            assert not data_crc or is_part_of(read.messages, made), k

    @given(data=st.data())
    @settings(max_examples=80, deadline=None)
    def test_cuts_flips_and_holes_in_any_number(self, containers, tmp_path_factory, data):
        options = data.draw(
            st.sampled_from(
                [{"compression": c} for c in COMPRESSIONS]
                + [{"chunked": False, "enable_data_crcs": True}, {"compression": "none", "index_types": IndexType.NONE}]
            )
        )
        made = containers.messages(150, seed=1)
        path = containers.write(tmp_path_factory.getbasetemp() / "any.mcap", made, chunk_size=2000, **options)
        content = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            at = data.draw(st.integers(8, len(content)))
            length = data.draw(st.integers(1, 3000))
            kind = data.draw(st.sampled_from(["flip", "zeros", "ones", "cut", "gone"]))
            if kind == "flip" and at < len(content):
                content[at] ^= data.draw(st.integers(1, 255))
            elif kind in ("zeros", "ones"):
                content[at : at + length] = (b"\0" if kind == "zeros" else b"\xff") * len(content[at : at + length])
            elif kind == "cut":
                del content[max(at, 9) :]
            elif kind == "gone":
                del content[at : at + length]
        read = containers.read_content(bytes(content))
        assert len(read.messages) <= len(made)
        if options.get("chunked", True) or "data_crc_mismatch" in read.codes:
            assert is_part_of(read.messages, made)

    @given(st.binary(max_size=400))
    @settings(max_examples=200, deadline=None)
    def test_any_bytes_behind_the_magic(self, containers, content):
        containers.read_content(b"\x89MCAP0\r\n" + content)

    @given(st.integers(1, 15), st.integers(0, 2**64 - 1), st.binary(max_size=100))
    @settings(max_examples=200, deadline=None)
    def test_any_record_of_a_known_kind(self, containers, opcode, length, content):
        for claimed in (length, len(content)):
            record = struct.pack("<BQ", opcode, claimed) + content
            assert containers.read_content(b"\x89MCAP0\r\n" + record).messages == []


def test_a_file_of_nothing_but_holes_is_given_up_in_the_end(containers, tmp_path, monkeypatch):
    monkeypatch.setattr("maglev_offline.logs.walk.MOST_HOLES", 10)
    path = tmp_path / "a.mcap"
    metadata = struct.pack("<BQII", 0x0C, 8, 0, 0) * 4
    path.write_bytes(b"\x89MCAP0\r\n" + (metadata + bytes(50)) * 100)
    read = containers.read(path)
    assert read.codes == ["bytes_unreadable"] * 10 + ["truncated"]


def test_metadata_without_end_is_not_kept(containers, tmp_path, monkeypatch):
    monkeypatch.setattr("maglev_offline.logs.walk.MOST_METADATA_BYTES", 70)
    path = containers.write(tmp_path / "a.mcap", containers.messages(10))
    path.write_bytes(path.read_bytes()[:8] + struct.pack("<BQI3sI", 0x0C, 11, 3, b"abc", 0) * 4 + path.read_bytes()[8:])
    read = containers.read(path)
    assert list(read.structure.metadata) == ["abc"]
    assert "record_too_large" in read.codes
