"""The structure of whole files, with and without a summary, in every form that writers give them."""

import struct
import zlib

import pytest
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import IndexType, Writer

from maglev_offline.logs.scan import read_structure
from maglev_offline.logs.source import Source, open_source
from maglev_offline.logs.structure import ChunkSpan, LooseSpan


def as_the_library_reads(path, containers):
    """All messages in file order."""
    with path.open("rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
    return [
        containers.Message(r.channel_id, r.sequence, r.log_time, r.publish_time, r.data)
        for r in records
        if type(r).__name__ == "Message"
    ]


class TestWholeFiles:
    @pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
    @pytest.mark.parametrize("chunked", [True, False])
    @pytest.mark.parametrize("index", [IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE])
    def test_every_message_in_file_order_as_the_library_has_it(self, containers, tmp_path, compression, chunked, index):
        made = containers.messages(2000)
        path = containers.write(tmp_path / "a.mcap", made, compression=compression, chunked=chunked, index_types=index)
        read = containers.read(path)
        assert read.damages == []
        assert read.messages == as_the_library_reads(path, containers) == made
        assert read.missing == 0
        structure = read.structure
        assert structure.whole
        assert {c.topic for c in structure.channels.values()} == {"/1", "/2", "/3"}
        assert structure.schemas[1].name == "test/Blob"
        assert structure.metadata == {"rig": {"operator": "k"}}
        assert structure.attachments == (("../photo.jpg", 999),)
        assert structure.compressions == ((compression,) if chunked else ())
        assert sum(structure.claimed.values()) == 2000

    @pytest.mark.parametrize("repeated", [{"repeat_channels": False}, {"repeat_schemas": False}])
    def test_declarations_that_stand_in_the_chunks_alone(self, containers, tmp_path, repeated):
        made = containers.messages(500)
        read = containers.read(containers.write(tmp_path / "a.mcap", made, **repeated))
        assert read.messages == made
        assert read.damages == []
        assert sorted(read.structure.channels) == [1, 2, 3]
        assert sorted(read.structure.schemas) == [1]

    def test_without_statistics_and_check_sums(self, containers, tmp_path):
        made = containers.messages(500)
        path = containers.write(tmp_path / "a.mcap", made, use_statistics=False, enable_crcs=False)
        read = containers.read(path)
        assert read.messages == made
        assert read.damages == []
        assert read.structure.claimed is None

    def test_no_messages(self, containers, tmp_path):
        read = containers.read(containers.write(tmp_path / "a.mcap", []))
        assert read.messages == []
        assert read.damages == []

    def test_recorded_logs(self, containers, levitador):
        for path in sorted(levitador.glob("*.mcap")):
            read = containers.read(path)
            assert read.damages == []
            assert read.messages == as_the_library_reads(path, containers)

    def test_the_chunks_are_not_read_where_a_summary_tells_of_them(self, containers, tmp_path):
        path = containers.write(tmp_path / "a.mcap", containers.messages(60_000), chunk_size=2**18)
        with open_source(path) as source:
            asked = []

            def counting(offset, length):
                asked.append(length)
                return source.read_at(offset, length)

            structure = read_structure(Source(source.name, source.size, False, counting))
        assert len(structure.spans) > 8
        assert len(asked) < len(structure.spans) + 8
        looked = Source(source.name, source.size, True, source._read)
        assert looked.size == source.size

    def test_long_runs_of_loose_messages_become_spans_of_bounded_size(self, containers, tmp_path, monkeypatch):
        monkeypatch.setattr("maglev_offline.logs.walk.LOOSE_SPAN_BYTES", 2**16)
        made = containers.messages(20_000)
        long = containers.Message(2, 7, 5, 6, bytes(2**18))
        made.insert(9_000, long)
        path = containers.write(tmp_path / "a.mcap", made, chunked=False)
        read = containers.read(path)
        assert read.messages == made
        assert read.damages == []
        lengths = sorted(span.length for span in read.structure.spans)
        assert all(isinstance(span, LooseSpan) for span in read.structure.spans)
        assert lengths[-1] == 2**18 + 31
        assert lengths[-2] <= 2**16


class TestDeclarations:
    def test_schema_id_0_is_no_schema(self, tmp_path, containers):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            writer.add_message(writer.register_channel("/a", "json", 0), 1, b"{}", 1)
            writer.finish()
        read = containers.read(path)
        assert read.structure.channels[1].schema_id == 0
        assert read.structure.schemas == {}
        assert read.damages == []
        assert len(read.messages) == 1

    def test_a_schema_that_is_declared_nowhere_is_told(self, tmp_path, containers):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            writer.add_message(writer.register_channel("/a", "json", 9), 1, b"{}", 1)
            writer.finish()
        read = containers.read(path)
        assert read.codes == ["missing_schema"]
        assert len(read.messages) == 1

    def test_two_channels_on_one_topic(self, tmp_path, containers):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            ids = [writer.register_channel("/a", "json", 0, {"n": n}) for n in "12"]
            for k in range(6):
                writer.add_message(ids[k % 2], k, b"{}", k)
            writer.finish()
        read = containers.read(path)
        assert [c.topic for c in read.structure.channels.values()] == ["/a", "/a"]
        assert [m.channel_id for m in read.messages] == [1, 2, 1, 2, 1, 2]

    def test_a_channel_that_is_declared_again_differently_is_told_and_the_first_counts(self, containers, tmp_path):
        path = containers.write(tmp_path / "a.mcap", containers.messages(500), compression="none", enable_crcs=False)
        at = path.read_bytes().index(b"\x02\x00\x00\x00/2")
        containers.damage(path, at + 5, b"9")
        read = containers.read(path)
        assert read.structure.channels[2].topic == "/2"
        assert read.codes == ["declaration_conflict"]
        assert "channel 2 (/2)" in read.damages[0].detail
        assert len(read.messages) == 500

    def test_messages_of_an_undeclared_channel_are_left_out_and_counted(self, containers, tmp_path):
        made = containers.messages(300, channels=3)
        path = containers.write(tmp_path / "a.mcap", made, compression="none", chunk_size=2**20, enable_crcs=False)
        whole = path.read_bytes()
        # The id of channel 3 becomes 77 in the chunk and in the summary, whose check sum is 0.
        at = whole.index(b"\x02\x00\x00\x00/3") - 4
        again = whole.rindex(b"\x02\x00\x00\x00/3") - 4
        assert at < again
        containers.damage(path, at, struct.pack("<H", 77))
        containers.damage(path, again, struct.pack("<H", 77))
        read = containers.read(path)
        assert read.codes == ["unknown_channel"]
        assert read.damages[0].messages == {3: 100}
        assert read.messages == [m for m in made if m.channel_id != 3]

    def test_huge_metadata_is_not_read(self, containers, tmp_path):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            writer.add_metadata("big", {"a": "x" * 2**24})
            writer.add_metadata("small", {"a": "x"})
            writer.finish()
        read = containers.read(path)
        assert read.structure.metadata == {"small": {"a": "x"}}
        assert read.codes == ["record_too_large"]


class TestDoubtsAboutTheSummary:
    def test_a_summary_that_fails_its_check_sum_is_not_used(self, containers, tmp_path):
        made = containers.messages(2000)
        path = containers.write(tmp_path / "a.mcap", made)
        start = struct.unpack("<Q", path.read_bytes()[-28:-20])[0]
        containers.flip(path, start + 30)
        read = containers.read(path)
        assert read.messages == made
        assert read.codes == ["summary_unusable"]
        assert not read.structure.whole

    def test_chunk_indexes_without_a_check_sum_are_held_against_the_file(self, containers, tmp_path):
        made = containers.messages(2000)
        path = containers.write(tmp_path / "a.mcap", made, enable_crcs=False)
        data = bytearray(path.read_bytes())
        index = data.rindex(struct.pack("<Q", containers.chunk_indexes(path)[2].chunk_start_offset))
        data[index] ^= 0x04
        path.write_bytes(data)
        read = containers.read(path)
        assert read.messages == made
        assert read.codes == ["summary_unusable"]

    def test_a_chunk_that_the_summary_does_not_list_is_found(self, containers, tmp_path):
        made = containers.messages(2000)
        path = containers.write(tmp_path / "a.mcap", made)
        data = path.read_bytes()
        start, offsets, _ = struct.unpack("<QQI", data[-28:-8])
        index = containers.chunk_indexes(path)[1]
        at = data.rindex(struct.pack("<Q", index.chunk_start_offset)) - 25
        length = 9 + struct.unpack_from("<Q", data, at + 1)[0]
        statistics = data.index(struct.pack("<BQ", 0x0B, 46 + 30), start)
        kept = data[start:statistics] + data[statistics + 9 + 76 : at] + data[at + length : offsets]
        footer = struct.pack("<BQQQ", 0x02, 20, start, 0)
        crc = zlib.crc32(kept + footer)
        path.write_bytes(data[:start] + kept + footer + struct.pack("<I", crc) + data[-8:])
        read = containers.read(path)
        assert read.messages == made
        assert read.damages == []
        assert read.structure.whole
        assert all(isinstance(span, ChunkSpan) for span in read.structure.spans)


def test_chunks_of_the_library_are_those_of_the_structure(containers, tmp_path):
    path = containers.write(tmp_path / "a.mcap", containers.messages(2000))
    with path.open("rb") as file:
        chunks = [r for r in StreamReader(file, emit_chunks=True).records if isinstance(r, Chunk)]
    assert len(containers.read(path).structure.spans) == len(chunks) > 10
