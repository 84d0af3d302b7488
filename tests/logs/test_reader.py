"""What the reader promises: the same columns from every encoding, in file order, and plain words for bad files."""

import struct
import zlib
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from maglev_offline.errors import LogError
from maglev_offline.logs.reader import NO_TIME, ClockField, list_channels, read_columns, read_info

ENCODINGS = ("json", "cdr", "protobuf")
TOPIC = "/suspension/F1/state"
T0 = 1_700_000_000_123_456_789


def a_log(mcap_files, path, n=300, **options):
    values = ({"gap_mm": 8.0 + k / 7, "state": {"coil_current_a": 20.0 - k}} for k in range(n))
    messages = [mcap_files.Msg(TOPIC, T0 + k * 10_000_000, value) for k, value in enumerate(values)]
    return mcap_files.write(path, messages, **options)


class TestChannels:
    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_numeric_fields_are_those_of_the_schema(self, mcap_files, tmp_path, encoding):
        value = {
            "stamp": mcap_files.Stamp(5, 6),
            "gap_mm": 8.0,
            "name": "F1",
            "state": {"coil_current_a": 20.0, "deeper": {"v": 1.0}},
        }
        path = mcap_files.write(tmp_path / "a.mcap", [mcap_files.Msg(TOPIC, T0, value)], encoding=encoding)
        (channel,) = list_channels(path)
        assert channel.topic == TOPIC
        assert channel.message_encoding == encoding
        assert channel.fields[2:] == ("gap_mm", "state.coil_current_a", "state.deeper.v")
        assert channel.times == ("stamp",)
        assert channel.has("stamp")
        assert not channel.has("name")

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_elements_of_a_list_have_their_index_in_the_path(self, mcap_files, tmp_path, encoding):
        messages = [mcap_files.Msg(TOPIC, T0, {"gaps": [8.0, 9.0]})]
        path = mcap_files.write(tmp_path / "a.mcap", messages, encoding=encoding)
        (channel,) = list_channels(path)
        assert channel.has("gaps.1")
        columns = read_columns(path, {TOPIC: ["gaps.1", "gaps.7"]}).topics[TOPIC]
        assert columns.values["gaps.1"] == [9.0]
        assert np.isnan(columns.values["gaps.7"])

    def test_json_without_a_schema_is_known_by_its_first_message(self, mcap_files, tmp_path):
        value = {"gap_mm": 8.0, "text": "x", "on": True, "maybe": None, "list": [1, 2]}
        path = mcap_files.write(tmp_path / "a.mcap", [mcap_files.Msg(TOPIC, T0, value)], json_schema=False)
        (channel,) = list_channels(path)
        assert channel.schema_name == ""
        assert channel.fields == ("gap_mm", "maybe", "list.0", "list.1")

    @pytest.mark.parametrize("chunked", [True, False])
    def test_counts_and_times(self, mcap_files, tmp_path, chunked):
        (channel,) = list_channels(a_log(mcap_files, tmp_path / "a.mcap", chunked=chunked))
        assert channel.message_count == 300
        assert (channel.first_log_time_ns, channel.last_log_time_ns) == (T0, T0 + 299 * 10_000_000)

    def test_metadata_says_whether_a_log_is_simulated(self, mcap_files, tmp_path):
        assert not read_info(a_log(mcap_files, tmp_path / "a.mcap")).simulated
        for chunked in (True, False):
            path = a_log(mcap_files, tmp_path / "b.mcap", metadata={"origin": {"simulated": "true"}}, chunked=chunked)
            assert read_info(path).simulated
            assert read_info(path).metadata == {"origin": {"simulated": "true"}}

    def test_a_summary_that_repeats_no_schemas_is_not_relied_upon(self, tmp_path):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file, repeat_schemas=False)
            writer.start()
            schema = writer.register_schema("a/B", "ros2msg", b"float64 x")
            writer.add_message(writer.register_channel("/a", "cdr", schema), 1, bytes([0, 1, 0, 0, *[0] * 8]), 1)
            writer.finish()
        assert list_channels(path)[0].fields == ("x",)


class TestColumns:
    @pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_file_order_and_every_encoding(self, mcap_files, tmp_path, encoding, compression):
        path = a_log(mcap_files, tmp_path / "a.mcap", encoding=encoding, compression=compression)
        log = read_columns(path, {TOPIC: ["state.coil_current_a", "gap_mm"]})
        columns = log.topics[TOPIC]
        assert log.message_counts == {TOPIC: 300}
        np.testing.assert_array_equal(columns.log_time_ns, T0 + np.arange(300) * 10_000_000)
        np.testing.assert_array_equal(columns.sequence, np.arange(300))
        np.testing.assert_array_equal(columns.values["gap_mm"], 8.0 + np.arange(300) / 7)
        np.testing.assert_array_equal(columns.values["state.coil_current_a"], 20.0 - np.arange(300))

    def test_messages_stay_in_file_order_when_their_times_go_back(self, mcap_files, tmp_path):
        times = [30, 10, 20]
        messages = [mcap_files.Msg(TOPIC, t, {"gap_mm": float(t)}) for t in times]
        columns = read_columns(mcap_files.write(tmp_path / "a.mcap", messages), {TOPIC: ["gap_mm"]}).topics[TOPIC]
        assert columns.log_time_ns.tolist() == times
        assert columns.values["gap_mm"].tolist() == times

    def test_unwanted_topics_are_counted_and_not_decoded(self, tmp_path):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            wanted = writer.register_channel("/a", "json", 0)
            other = writer.register_channel("/b", "morse", 0)
            writer.add_message(other, 1, b"...---...", 1)
            writer.add_message(wanted, 2, b'{"x": 1}', 2)
            writer.finish()
        log = read_columns(path, {"/a": ["x"]})
        assert log.message_counts == {"/a": 1, "/b": 1}
        assert log.topics["/a"].file_index.tolist() == [1]

    def test_what_is_missing_or_no_number_is_nan(self, mcap_files, tmp_path):
        values = [1.5, 2, None, "3", True, [4], float("nan"), float("inf"), 10**400]
        messages = [mcap_files.Msg(TOPIC, k, {"x": v}) for k, v in enumerate(values)]
        messages.append(mcap_files.Msg(TOPIC, 99, {}))
        path = mcap_files.write(tmp_path / "a.mcap", messages)
        x = read_columns(path, {TOPIC: ["x"]}).topics[TOPIC].values["x"]
        np.testing.assert_array_equal(x, [1.5, 2.0, *[np.nan] * 5, np.inf, np.nan, np.nan])

    def test_two_channels_on_one_topic_are_merged_in_file_order(self, tmp_path):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channels = [writer.register_channel("/a", "json", 0, {"n": n}) for n in "12"]
            for k in range(6):
                writer.add_message(channels[k % 2], k, b'{"x": %d}' % k, k)
            writer.finish()
        assert read_columns(path, {"/a": ["x"]}).topics["/a"].values["x"].tolist() == [0, 1, 2, 3, 4, 5]

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_a_header_stamp_keeps_its_nanoseconds(self, mcap_files, tmp_path, encoding):
        stamps = [mcap_files.Stamp(1_700_000_000, 1), mcap_files.Stamp(1_700_000_000, 999_999_999)]
        messages = [mcap_files.Msg(TOPIC, 0, {"stamp": stamp, "x": 1.0}) for stamp in stamps]
        path = mcap_files.write(tmp_path / "a.mcap", messages, encoding=encoding)
        columns = read_columns(path, {TOPIC: ["x", "stamp"]}, {TOPIC: ClockField("stamp")}).topics[TOPIC]
        assert columns.clock_ns.tolist() == [1_700_000_000_000_000_001, 1_700_000_000_999_999_999]
        np.testing.assert_allclose(columns.values["stamp"], [1.7e9, 1.7e9 + 1], rtol=1e-12)

    def test_a_plain_number_as_a_clock(self, mcap_files, tmp_path):
        messages = [mcap_files.Msg(TOPIC, 0, {"us": v}) for v in (1_700_000_000_000_001, 2.5, None, "x")]
        path = mcap_files.write(tmp_path / "a.mcap", messages)
        columns = read_columns(path, {TOPIC: ["us"]}, {TOPIC: ClockField("us", 1e3)}).topics[TOPIC]
        assert columns.clock_ns.tolist() == [1_700_000_000_000_001_000, 2500, NO_TIME, NO_TIME]

    def test_a_payload_that_cannot_be_decoded_is_marked(self, tmp_path):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/a", "json", 0)
            for k, payload in enumerate((b'{"x": 1}', b'{"x": ', b"\xff\xfe")):
                writer.add_message(channel, k, payload, k)
            writer.finish()
        columns = read_columns(path, {"/a": ["x"]}).topics["/a"]
        assert columns.decoded.tolist() == [True, False, False]
        np.testing.assert_array_equal(columns.values["x"], [1.0, np.nan, np.nan])

    @given(st.lists(st.floats(width=64, allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
    @settings(max_examples=25, deadline=None)
    def test_the_three_encodings_decode_to_the_same_bits(self, mcap_files, tmp_path_factory, values):
        folder = tmp_path_factory.mktemp("same")
        messages = [mcap_files.Msg(TOPIC, k, {"x": v, "inner": {"y": -v}}) for k, v in enumerate(values)]
        found = []
        for encoding in ENCODINGS:
            path = mcap_files.write(folder / encoding, messages, encoding=encoding)
            columns = read_columns(path, {TOPIC: ["x", "inner.y"]}).topics[TOPIC]
            found.append(np.stack([columns.values["x"], columns.values["inner.y"]]))
        np.testing.assert_array_equal(found[0], found[1])
        np.testing.assert_array_equal(found[0], found[2])
        np.testing.assert_array_equal(found[0][0], values)

    @pytest.mark.parametrize(
        ("name", "rows"),
        [("step_json", 2989), ("multistep_json", 3487), ("constant_ros2", 2989), ("sine_protobuf", 2884)],
    )
    def test_recorded_logs(self, levitador, name, rows):
        columns = read_columns(levitador / f"{name}.mcap", {"/levitator/state": ["y", "i", "u", "yd"]})
        state = columns.topics["/levitator/state"]
        assert len(state) == rows
        assert all(np.isfinite(column).all() for column in state.values.values())
        assert (np.diff(state.log_time_ns) == 10_000_000).all()
        assert 0 <= state.values["u"].min() <= state.values["u"].max() <= 9.86


def refused(path):
    """The paragraph with which a file is refused."""
    with pytest.raises(LogError) as found:
        read_columns(path, {channel.topic: channel.fields for channel in list_channels(path)})
    assert found.value.exit_code == 2
    assert str(path) in found.value.paragraph()
    assert found.value.todo
    return found.value.what


class TestDamage:
    def test_a_file_that_is_not_there(self, tmp_path):
        assert "cannot be opened" in refused(tmp_path / "none.mcap")

    def test_a_folder(self, tmp_path):
        assert "folder" in refused(tmp_path)

    def test_an_empty_file(self, tmp_path):
        (tmp_path / "a.mcap").touch()
        assert "0 bytes" in refused(tmp_path / "a.mcap")

    @pytest.mark.parametrize("content", [b"t,gap\n0,8\n", b"\x89", b"\x89MCAP1\r\n" * 4])
    def test_no_mcap_at_all(self, tmp_path, content):
        (tmp_path / "a.mcap").write_bytes(content)
        assert "not an MCAP file" in refused(tmp_path / "a.mcap")

    @pytest.mark.parametrize("share", [0.1, 0.7, 0.999])
    def test_cut_off(self, mcap_files, tmp_path, share):
        path = a_log(mcap_files, tmp_path / "a.mcap")
        whole = path.read_bytes()
        path.write_bytes(whole[: int(len(whole) * share)])
        assert "cut off" in refused(path)

    def test_only_the_magic_bytes(self, tmp_path):
        (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n")
        assert "cut off" in refused(tmp_path / "a.mcap")

    def test_trailing_zeros(self, mcap_files, tmp_path):
        path = a_log(mcap_files, tmp_path / "a.mcap")
        path.write_bytes(path.read_bytes() + bytes(4096))
        assert "cut off" in refused(path)

    @pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
    def test_a_flipped_byte_in_a_chunk(self, mcap_files, tmp_path, compression):
        path = a_log(mcap_files, tmp_path / "a.mcap", compression=compression)
        data = bytearray(path.read_bytes())
        chunk = summary_of(path).chunk_indexes[1]
        data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
        path.write_bytes(data)
        assert "damaged" in refused(path)

    def test_a_hole_of_zeros(self, mcap_files, tmp_path):
        path = a_log(mcap_files, tmp_path / "a.mcap", n=3000)
        data = bytearray(path.read_bytes())
        data[8000:16000] = bytes(8000)
        path.write_bytes(data)
        assert "damaged" in refused(path)

    def test_a_flipped_record_length(self, mcap_files, tmp_path):
        path = a_log(mcap_files, tmp_path / "a.mcap")
        data = bytearray(path.read_bytes())
        data[summary_of(path).chunk_indexes[1].chunk_start_offset + 6] ^= 0x01
        path.write_bytes(data)
        assert "damaged" in refused(path)

    def test_every_single_flipped_byte_is_told_in_plain_words_or_harmless(self, mcap_files, tmp_path):
        whole = a_log(mcap_files, tmp_path / "a.mcap", n=12, chunk_size=200).read_bytes()
        path = tmp_path / "b.mcap"
        for k in range(0, len(whole), 3):
            path.write_bytes(whole[:k] + bytes([whole[k] ^ 0xFF]) + whole[k + 1 :])
            with suppress(LogError):
                read_columns(path, {channel.topic: channel.fields for channel in list_channels(path)})

    def test_a_chunk_that_claims_a_huge_size(self, mcap_files, tmp_path):
        path = a_log(mcap_files, tmp_path / "a.mcap", compression="lz4")
        data = bytearray(path.read_bytes())
        struct.pack_into("<Q", data, summary_of(path).chunk_indexes[0].chunk_start_offset + 9 + 16, 2**50)
        path.write_bytes(data)
        assert "claims to hold" in refused(path)

    def test_an_unknown_compression(self, mcap_files, tmp_path):
        path = a_log(mcap_files, tmp_path / "a.mcap", json_schema=False)
        path.write_bytes(path.read_bytes().replace(b"\x04\x00\x00\x00zstd", b"\x04\x00\x00\x00lzma"))
        assert "compressed with 'lzma'" in refused(path)

    def test_an_unknown_encoding(self, tmp_path):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/a", "cdr", writer.register_schema("a/B", "ros2idl", b"module a {}"))
            writer.add_message(channel, 1, b"\x00\x01\x00\x00", 1)
            writer.finish()
        (found,) = list_channels(path)
        assert not found.decodable
        assert found.fields == ()
        with pytest.raises(LogError, match="'cdr' with schema encoding 'ros2idl', which cannot be decoded"):
            read_columns(path, {"/a": ["x"]})

    @pytest.mark.parametrize(
        ("encoding", "schema_encoding", "schema", "payload"),
        [
            ("cdr", "ros2msg", b"float64 x", b"\x00\x01\x00\x00\x00"),
            ("protobuf", "protobuf", b"\xff\xff", b"\x09"),
            ("cdr", "ros2msg", b"no_such_type[x y", b"\x00\x01\x00\x00"),
            ("cdr", "ros2msg", b"\xff\xfe", b"\x00\x01\x00\x00"),
            ("json", "jsonschema", b"{", b"nothing"),
        ],
    )
    def test_messages_that_do_not_fit_their_schema(self, tmp_path, encoding, schema_encoding, schema, payload):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/a", encoding, writer.register_schema("a/B", schema_encoding, schema))
            writer.add_message(channel, 1, payload, 1)
            writer.finish()
        list_channels(path)
        with pytest.raises(LogError, match=r"cannot be read|can be decoded"):
            read_columns(path, {"/a": ["x"]})

    def test_a_count_that_does_not_hold(self, mcap_files, tmp_path):
        path = a_log(mcap_files, tmp_path / "a.mcap", chunked=False)
        data = bytearray(path.read_bytes())
        summary_start, _, crc = struct.unpack_from("<QQI", data, len(data) - 28)
        assert crc == zlib.crc32(data[summary_start : len(data) - 12])
        at = data.index(b"\x0b", summary_start)
        while struct.unpack_from("<Q", data, at + 9)[0] != 300:
            at = data.index(b"\x0b", at + 1)
        struct.pack_into("<Q", data, at + 9, 301)
        path.write_bytes(data)
        assert "says that it holds 301 messages" in refused(path)


def summary_of(path):
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return make_reader(file).get_summary() or SimpleNamespace()
