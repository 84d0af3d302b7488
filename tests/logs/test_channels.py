"""What a log says of itself: channels, fields, counts, times, metadata."""

import numpy as np
import pytest
from mcap.writer import Writer

from maglev_offline.logs.channels import list_channels, read_info
from maglev_offline.logs.reader import read_columns

ENCODINGS = ("json", "cdr", "protobuf")
TOPIC = "/suspension/F1/state"
T0 = 1_700_000_000_123_456_789


def a_log(mcap_files, path, n=300, **options):
    values = ({"gap_mm": 8.0 + k / 7, "state": {"coil_current_a": 20.0 - k}} for k in range(n))
    messages = [mcap_files.Msg(TOPIC, T0 + k * 10_000_000, value) for k, value in enumerate(values)]
    return mcap_files.write(path, messages, **options)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_numeric_fields_are_those_of_the_schema(mcap_files, tmp_path, encoding):
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
def test_elements_of_a_list_have_their_index_in_the_path(mcap_files, tmp_path, encoding):
    messages = [mcap_files.Msg(TOPIC, T0, {"gaps": [8.0, 9.0]})]
    path = mcap_files.write(tmp_path / "a.mcap", messages, encoding=encoding)
    (channel,) = list_channels(path)
    assert channel.has("gaps.1")
    columns = read_columns(path, {TOPIC: ["gaps.1", "gaps.7"]})[TOPIC]
    assert columns.values["gaps.1"] == [9.0]
    assert np.isnan(columns.values["gaps.7"])


def test_json_without_a_schema_is_known_by_its_first_message(mcap_files, tmp_path):
    value = {"gap_mm": 8.0, "text": "x", "on": True, "maybe": None, "list": [1, 2]}
    path = mcap_files.write(tmp_path / "a.mcap", [mcap_files.Msg(TOPIC, T0, value)], json_schema=False)
    (channel,) = list_channels(path)
    assert channel.schema_name == ""
    assert channel.fields == ("gap_mm", "maybe", "list.0", "list.1")


@pytest.mark.parametrize("chunked", [True, False])
def test_counts_and_times(mcap_files, tmp_path, chunked):
    (channel,) = list_channels(a_log(mcap_files, tmp_path / "a.mcap", chunked=chunked))
    assert channel.message_count == 300
    assert (channel.first_log_time_ns, channel.last_log_time_ns) == (T0, T0 + 299 * 10_000_000)


def test_metadata_says_whether_a_log_is_simulated(mcap_files, tmp_path):
    assert not read_info(a_log(mcap_files, tmp_path / "a.mcap")).simulated
    for chunked in (True, False):
        path = a_log(mcap_files, tmp_path / "b.mcap", metadata={"origin": {"simulated": "true"}}, chunked=chunked)
        assert read_info(path).simulated
        assert read_info(path).metadata == {"origin": {"simulated": "true"}}


def test_a_summary_that_repeats_no_schemas_is_not_relied_upon(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, repeat_schemas=False)
        writer.start()
        schema = writer.register_schema("a/B", "ros2msg", b"float64 x")
        writer.add_message(writer.register_channel("/a", "cdr", schema), 1, bytes([0, 1, 0, 0, *[0] * 8]), 1)
        writer.finish()
    assert list_channels(path)[0].fields == ("x",)
