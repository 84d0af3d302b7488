"""What the reader promises: the same columns from every encoding, in file order; what cannot be read is marked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from maglev_offline.errors import LogError
from maglev_offline.logs.channels import list_channels
from maglev_offline.logs.columns import NO_TIME
from maglev_offline.logs.decode.library import ClockField
from maglev_offline.logs.reader import TopicWanted, read_columns, read_run, runs, topic_columns
from maglev_offline.logs.scan import read_structure
from maglev_offline.logs.source import open_source

ENCODINGS = ("json", "cdr", "protobuf")
TOPIC = "/suspension/F1/state"
T0 = 1_700_000_000_123_456_789


def a_log(mcap_files, path, n=300, **options):
    values = ({"gap_mm": 8.0 + k / 7, "state": {"coil_current_a": 20.0 - k}} for k in range(n))
    messages = [mcap_files.Msg(TOPIC, T0 + k * 10_000_000, value) for k, value in enumerate(values)]
    return mcap_files.write(path, messages, **options)


class TestColumns:
    @pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_file_order_and_every_encoding(self, mcap_files, tmp_path, encoding, compression):
        path = a_log(mcap_files, tmp_path / "a.mcap", encoding=encoding, compression=compression)
        columns = read_columns(path, {TOPIC: ["state.coil_current_a", "gap_mm"]})[TOPIC]
        np.testing.assert_array_equal(columns.log_time_ns, T0 + np.arange(300) * 10_000_000)
        np.testing.assert_array_equal(columns.sequence, np.arange(300))
        np.testing.assert_array_equal(columns.values["gap_mm"], 8.0 + np.arange(300) / 7)
        np.testing.assert_array_equal(columns.values["state.coil_current_a"], 20.0 - np.arange(300))

    def test_messages_stay_in_file_order_when_their_times_go_back(self, mcap_files, tmp_path):
        times = [30, 10, 20]
        messages = [mcap_files.Msg(TOPIC, t, {"gap_mm": float(t)}) for t in times]
        columns = read_columns(mcap_files.write(tmp_path / "a.mcap", messages), {TOPIC: ["gap_mm"]})[TOPIC]
        assert columns.log_time_ns.tolist() == times
        assert columns.values["gap_mm"].tolist() == times

    def test_unwanted_topics_are_not_decoded(self, tmp_path):
        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            wanted = writer.register_channel("/a", "json", 0)
            other = writer.register_channel("/b", "morse", 0)
            writer.add_message(other, 1, b"...---...", 1)
            writer.add_message(wanted, 2, b'{"x": 1}', 2)
            writer.finish()
        assert read_columns(path, {"/a": ["x"]})["/a"].file_index.tolist() == [1]

    def test_what_is_missing_or_no_number_is_nan(self, mcap_files, tmp_path):
        values = [1.5, 2, None, "3", True, [4], float("nan"), float("inf"), 10**400]
        messages = [mcap_files.Msg(TOPIC, k, {"x": v}) for k, v in enumerate(values)]
        messages.append(mcap_files.Msg(TOPIC, 99, {}))
        path = mcap_files.write(tmp_path / "a.mcap", messages)
        x = read_columns(path, {TOPIC: ["x"]})[TOPIC].values["x"]
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
        assert read_columns(path, {"/a": ["x"]})["/a"].values["x"].tolist() == [0, 1, 2, 3, 4, 5]

    @pytest.mark.parametrize("encoding", ENCODINGS)
    def test_a_header_stamp_keeps_its_nanoseconds(self, mcap_files, tmp_path, encoding):
        stamps = [mcap_files.Stamp(1_700_000_000, 1), mcap_files.Stamp(1_700_000_000, 999_999_999)]
        messages = [mcap_files.Msg(TOPIC, 0, {"stamp": stamp, "x": 1.0}) for stamp in stamps]
        path = mcap_files.write(tmp_path / "a.mcap", messages, encoding=encoding)
        columns = read_columns(path, {TOPIC: ["x", "stamp"]}, {TOPIC: ClockField("stamp")})[TOPIC]
        assert columns.clock_ns.tolist() == [1_700_000_000_000_000_001, 1_700_000_000_999_999_999]
        np.testing.assert_allclose(columns.values["stamp"], [1.7e9, 1.7e9 + 1], rtol=1e-12)

    def test_a_plain_number_as_a_clock(self, mcap_files, tmp_path):
        messages = [mcap_files.Msg(TOPIC, 0, {"us": v}) for v in (1_700_000_000_000_001, 2.5, None, "x")]
        path = mcap_files.write(tmp_path / "a.mcap", messages)
        columns = read_columns(path, {TOPIC: ["us"]}, {TOPIC: ClockField("us", 1e3)})[TOPIC]
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
        columns = read_columns(path, {"/a": ["x"]})["/a"]
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
            columns = read_columns(path, {TOPIC: ["x", "inner.y"]})[TOPIC]
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
        state = columns["/levitator/state"]
        assert len(state) == rows
        assert all(np.isfinite(column).all() for column in state.values.values())
        assert (np.diff(state.log_time_ns) == 10_000_000).all()
        assert 0 <= state.values["u"].min() <= state.values["u"].max() <= 9.86


class TestRefusal:
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
        with pytest.raises(LogError, match="encoding 'cdr' with schema encoding 'ros2idl' is not known"):
            read_columns(path, {"/a": ["x"]})

    @pytest.mark.parametrize(
        ("encoding", "schema_encoding", "schema"),
        [
            ("protobuf", "protobuf", b"\xff\xff"),
            ("cdr", "ros2msg", b"no_such_type[x y"),
            ("cdr", "ros2msg", b"\xff\xfe"),
            ("ros1", "ros1msg", b"import os"),
            ("ros1", "ros1msg", b"float64 x; import os"),
        ],
    )
    def test_a_schema_that_cannot_be_read(self, tmp_path, encoding, schema_encoding, schema):
        path = one_message(tmp_path, encoding, schema_encoding, schema, b"\x00\x01\x00\x00")
        list_channels(path)
        with pytest.raises(LogError, match="topic /a cannot be decoded") as found:
            read_columns(path, {"/a": ["x"]})
        assert found.value.exit_code == 2
        assert str(path) in found.value.paragraph()

    @pytest.mark.parametrize(
        ("encoding", "schema_encoding", "schema", "payload"),
        [
            ("cdr", "ros2msg", b"float64 x", b"\x00\x01\x00\x00\x00"),
            ("ros1", "ros1msg", b"float64 x", b"\x00"),
            ("json", "jsonschema", b"{", b"nothing"),
            ("json", "jsonschema", b"{}", b"[" * 100_000),
        ],
    )
    def test_messages_that_do_not_fit_their_schema_are_marked(
        self, tmp_path, encoding, schema_encoding, schema, payload
    ):
        path = one_message(tmp_path, encoding, schema_encoding, schema, payload)
        assert read_columns(path, {"/a": ["x"]})["/a"].decoded.tolist() == [False]


def one_message(folder, encoding, schema_encoding, schema, payload):
    path = folder / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/a", encoding, writer.register_schema("a/B", schema_encoding, schema))
        writer.add_message(channel, 1, payload, 1)
        writer.finish()
    return path


def test_ros1_through_the_library(tmp_path):
    schema = b"uint8 MODE=1\nstring WORD=a # quoted\nHeader header\nfloat64[2] gaps\ntime at\n"
    schema += b"=" * 80 + b"\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    payload = (
        np.array([1, 5, 6, 0], "<u4").tobytes() + np.array([8.0, 9.0]).tobytes() + np.array([7, 8], "<u4").tobytes()
    )
    path = one_message(tmp_path, "ros1", "ros1msg", schema, payload)
    (channel,) = list_channels(path)
    assert channel.times == ("header.stamp", "at")
    found = read_columns(path, {"/a": ["gaps.1", "at"]}, {"/a": ClockField("header.stamp")})["/a"]
    assert found.values["gaps.1"] == [9.0]
    assert found.values["at"] == [7.000000008]
    assert found.clock_ns.tolist() == [5_000_000_006]


class TestRuns:
    def test_slabs_on_disk_are_those_in_memory(self, mcap_files, tmp_path, monkeypatch):
        monkeypatch.setattr("maglev_offline.logs.reader.ROWS", 70)
        messages = [mcap_files.Msg(f"/{'ab'[k % 3 == 0]}", T0 + k, {"x": float(k), "t": k}) for k in range(500)]
        path = mcap_files.write(tmp_path / "a.mcap", messages, chunk_size=700)
        wanted = {topic: TopicWanted(("x",), ClockField("t", 1.0)) for topic in ["/a", "/b"]}
        with open_source(path) as source:
            structure = read_structure(source)
            (spans,) = runs(structure)
            memory = read_run(source, structure, spans, wanted)
            disk = read_run(source, structure, spans, wanted, spill_to=tmp_path / "slabs")
        assert len(memory.slabs) > 3
        for topic in wanted:
            pair = [topic_columns(read.slabs, topic, wanted[topic]) for read in (memory, disk)]
            for one, other in zip(*(columns.arrays() for columns in pair), strict=True):
                np.testing.assert_array_equal(one, other)
                assert one.dtype == other.dtype
        everything = [int(k) for topic in wanted for k in topic_columns(disk.slabs, topic, wanted[topic]).file_index]
        assert sorted(everything) == list(range(500))
