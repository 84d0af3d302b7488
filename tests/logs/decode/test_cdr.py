import importlib.util
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap_ros2._dynamic import serialize_dynamic

from maglev_offline.logs.decode.cdr import compile_cdr
from maglev_offline.logs.decode.library import UNDECODABLE, ClockField, Decoders, clock_ns, number, value_at
from maglev_offline.logs.decode.payloads import NO_TIME, Payloads, Wanted

_spec = importlib.util.spec_from_file_location("ros2_messages", Path(__file__).with_name("ros2_messages.py"))
ros2 = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(ros2)

UNITS = (1e9, 1e6, 1.0, 0.5, 1e3 / 3, 1e30)


def library(name, text):
    channel = Channel(id=1, topic="/a", message_encoding="cdr", metadata={}, schema_id=1)
    return Decoders().of(channel, Schema(id=1, name=name, encoding="ros2msg", data=text.encode()))


def payloads(messages, *, between=b"\xff\xee\xdd", behind=b""):
    start, data = [], b""
    for message in messages:
        data += between
        start.append(len(data))
        data += message
    lengths = np.array([len(m) for m in messages], dtype=np.int64)
    return Payloads(np.frombuffer(data + behind, dtype=np.uint8), np.array(start, dtype=np.int64), lengths)


def decode(name, text, messages, paths, clock=None, **where):
    wanted = Wanted(tuple(tuple(p.split(".")) if isinstance(p, str) else p for p in paths), clock)
    (decoder,) = compile_cdr(name, text.encode(), wanted)
    return decoder, decoder.decode(payloads(messages, **where))


def expected(name, text, message, paths, clock):
    """Bytes of the numbers, and the stamp; None where the library gives the message up."""
    try:
        content = library(name, text)(message)
        numbers = [number(value_at(content, path)) for path in paths]
        stamp = clock_ns(value_at(content, clock.path.split(".")), clock.ns_per_unit)
    except UNDECODABLE:
        return None
    return np.array(numbers).tobytes(), NO_TIME if stamp is None else stamp


def got(decoded, row):
    return decoded.values[:, row].tobytes(), int(decoded.stamp_ns[row])


@st.composite
def batches(draw, *, fixed=False):
    types = draw(ros2.message_types(fixed=fixed))
    messages = draw(st.lists(st.tuples(ros2.values(types, "test_msgs/T0"), st.sampled_from("<>")), max_size=6))
    paths = ros2.paths(types, "test_msgs/T0")[:80]
    clock = ClockField(".".join(draw(st.sampled_from(paths))), draw(st.sampled_from(UNITS)))
    return types, messages, paths, clock


def every_row_as_the_library(types, messages, paths, clock):
    text = ros2.schema_text(types)
    encoded = [ros2.encode(types, "test_msgs/T0", value, order) for value, order in messages]
    decoder, decoded = decode("test_msgs/T0", text, encoded, paths, clock)
    assert decoded.sure.all()
    for row, message in enumerate(encoded):
        assert got(decoded, row) == expected("test_msgs/T0", text, message, paths, clock)
    return decoder


@settings(deadline=None, max_examples=150)
@given(batches())
def test_every_message_that_the_library_decodes_is_read_to_the_last_bit(batch):
    every_row_as_the_library(*batch)


@settings(deadline=None, max_examples=60)
@given(batches(fixed=True))
def test_messages_without_strings_and_sequences_are_read_by_their_layout(batch):
    assert every_row_as_the_library(*batch).rung == "fixed_layout"


@settings(deadline=None, max_examples=40)
@given(batches())
def test_the_encoder_of_these_tests_is_that_of_the_library(batch):
    types, messages, _, _ = batch
    library_encoder = serialize_dynamic("test_msgs/T0", ros2.schema_text(types))["test_msgs/T0"]
    for value, _ in messages:
        assert ros2.encode(types, "test_msgs/T0", value, "<") == library_encoder(value)


@settings(deadline=None, max_examples=150)
@given(batches(), st.data())
def test_damaged_messages_are_not_sure_or_what_the_library_makes_of_them(batch, data):
    types, messages, paths, clock = batch
    text, encoded = ros2.schema_text(types), []
    for value, order in messages:
        whole = bytearray(ros2.encode(types, "test_msgs/T0", value, order))
        for _ in range(data.draw(st.integers(0, 2))):
            whole[data.draw(st.integers(0, len(whole) - 1))] ^= data.draw(st.sampled_from([1, 4, 128, 255]))
        encoded.append(bytes(whole[: data.draw(st.integers(0, len(whole)) | st.just(len(whole)))]))
    _, decoded = decode("test_msgs/T0", text, encoded, paths, clock, between=data.draw(st.binary(max_size=9)))
    for row in np.flatnonzero(decoded.sure):
        assert got(decoded, row) == expected("test_msgs/T0", text, encoded[row], paths, clock)


@settings(deadline=None, max_examples=100)
@given(batches(), st.lists(st.binary(max_size=60), max_size=5))
def test_any_bytes_at_all_are_not_sure_or_what_the_library_makes_of_them(batch, encoded):
    types, _, paths, clock = batch
    text = ros2.schema_text(types)
    _, decoded = decode("test_msgs/T0", text, encoded, paths, clock, between=b"")
    for row in np.flatnonzero(decoded.sure):
        assert got(decoded, row) == expected("test_msgs/T0", text, encoded[row], paths, clock)


STATE = "builtin_interfaces/Time stamp\nstring frame\nfloat64 gap\nfloat64[] coils\nstring note\n"


def state(sec=1, nanosec=2, frame="m1", gap=0.01, coils=(1.0, 2.0), note="", order="<"):
    types = {
        "a/State": [
            ros2.Field("stamp", ros2.TIME),
            ros2.Field("frame", "string"),
            ros2.Field("gap", "float64"),
            ros2.Field("coils", "float64", "free"),
            ros2.Field("note", "string"),
        ]
    }
    stamp = {"sec": sec, "nanosec": nanosec}
    value = {"stamp": stamp, "frame": frame, "gap": gap, "coils": list(coils), "note": note}
    return ros2.encode(types, "a/State", value, order)


def test_thousands_of_messages_behind_strings_of_all_lengths_come_out_in_their_order():
    messages = [
        state(sec=k, frame="x" * (k % 23), gap=k / 7, coils=[k + 0.5] * (k % 3), order="<>"[k % 5 == 0])
        for k in range(9000)
    ]
    decoder, found = decode("a/State", STATE, messages, ["gap", "coils.1", "stamp"], ClockField("stamp"))
    k = np.arange(9000)
    assert decoder.rung == "cursor"
    assert found.sure.all()
    np.testing.assert_array_equal(found.values[0], k / 7)
    np.testing.assert_array_equal(found.values[1], np.where(k % 3 > 1, k + 0.5, np.nan))
    np.testing.assert_array_equal(found.stamp_ns, k * 1_000_000_000 + 2)
    np.testing.assert_array_equal(found.values[2], (k * 1_000_000_000 + 2) / 1e9)


@pytest.mark.parametrize("frame", ["", "a", "é", "日本", "x" * 7 + "é", "x" * 300, "é" * 300])
def test_strings_of_any_length_and_script_are_stepped_over(frame):
    _, found = decode("a/State", STATE, [state(frame=frame, note=frame)] * 3, ["gap", "coils.0"])
    assert found.sure.all()
    assert found.values.tolist() == [[0.01] * 3, [1.0] * 3]


@pytest.mark.parametrize("length", [4, 9, 80])
def test_a_string_that_is_no_utf8_is_not_sure_though_nobody_wants_it(length):
    broken = state(note="~" * length).replace(b"~" * length, b"~" * (length - 1) + b"\xff")
    _, found = decode("a/State", STATE, [state(), broken, state()], ["gap"], behind=b"behind all")
    assert found.sure.tolist() == [True, False, True]


def test_a_message_that_ends_behind_the_wanted_fields_but_before_its_end_is_not_sure():
    whole = state(note="note")
    cut = [whole[:end] for end in range(len(whole))]
    _, found = decode("a/State", STATE, [*cut, whole, whole + b"more"], ["gap"])
    assert found.sure.tolist() == [False] * len(cut) + [True, True]
    _, fixed = decode("a/A", "float64 gap\nfloat64 coil", [bytes([0, 1, 0, 0]) + bytes(12)], ["gap"])
    assert not fixed.sure.any()


@pytest.mark.parametrize("head", [b"\x00\x02\x00\x00", b"\x00\x03\x00\x00", b"\x00\x07\x00\x00", b"\x01\x01\x00\x00"])
def test_other_encapsulations_are_left_to_the_library(head):
    _, found = decode("a/State", STATE, [head + state()[4:]], ["gap"])
    assert not found.sure.any()


@pytest.mark.parametrize("claimed", [100, 2**31, 2**32 - 1])
@pytest.mark.parametrize("line", ["float64[] x", "string[] x", "string x", "Inner[] x"])
def test_a_length_that_cannot_be_true_is_not_believed(line, claimed):
    text = f"{line}\n===\nMSG: a/Inner\nuint8 a"
    message = bytes([0, 1, 0, 0]) + struct.pack("<I", claimed) + bytes(40)
    _, found = decode("a/A", text, [message] * 3, ["x.0", "x.99.a", "x.4294967290"])
    assert not found.sure.any()


def test_a_very_long_sequence_of_strings_is_left_to_the_library_and_does_not_hold_up_the_others():
    types = {"a/A": [ros2.Field("names", "string", "free"), ros2.Field("gap", "float64")]}
    long, short = ({"names": ["a"] * n, "gap": 0.5} for n in (50_000, 2))
    messages = [ros2.encode(types, "a/A", value, "<") for value in (short, long, short)]
    _, found = decode("a/A", "string[] names\nfloat64 gap", messages, ["gap"])
    assert found.sure.tolist() == [True, False, True]
    assert found.values[0, ::2].tolist() == [0.5, 0.5]


def test_sequences_in_sequences_do_not_multiply():
    inner = ros2.Field("x", "a/B", "free")
    types = {"a/A": [inner], "a/B": [ros2.Field("y", "a/C", "free")], "a/C": [ros2.Field("z", "uint8", "free")]}
    value = {"x": [{"y": [{"z": [1]}] * 100}] * 100}
    text = ros2.schema_text(types)
    _, found = decode("a/A", text, [ros2.encode(types, "a/A", value, "<")], ["x.1.y.2.z.0"])
    assert not found.sure.any()


def test_a_type_without_members_takes_one_byte():
    types = {
        "a/A": [ros2.Field("before", "a/Nothing"), ros2.Field("x", "uint8"), ros2.Field("behind", "a/Nothing")],
        "a/Nothing": [],
    }
    whole = ros2.encode(types, "a/A", {"before": {}, "x": 7, "behind": {}}, "<")
    assert whole == bytes([0, 1, 0, 0, 0, 7, 0])
    _, found = decode("a/A", ros2.schema_text(types), [whole, whole[:-1]], ["x"])
    assert found.values[0, 0] == number(library("a/A", ros2.schema_text(types))(whole).x) == 7.0
    assert found.sure.tolist() == [True, False]


def test_bits_of_a_nan_are_kept():
    bits = np.array([0x7FF8000000000000, 0x7FF0000000000001, 0xFFF8DEADBEEF0001], dtype="<u8")
    messages = [bytes([0, 1, 0, 0]) + one.tobytes() for one in bits]
    _, found = decode("a/A", "float64 gap", messages, ["gap"])
    assert found.values.view(np.uint64).tolist() == [bits.tolist()]


@pytest.mark.parametrize("kind", ["int64", "uint64"])
@pytest.mark.parametrize("sec", [2**62, 2**63 - 1, 9_223_372_036, 9_223_372_037, 4_000_000_000, 4_000_000_001])
def test_times_beyond_int64_are_what_python_makes_of_them(kind, sec):
    text = f"Stamp stamp\n===\nMSG: a/Stamp\n{kind} sec\n{kind} nanosec"
    body = struct.pack("<" + ("q" if kind == "int64" else "Q") * 2, sec, 2**63 - 1)
    message = bytes([0, 1, 0, 0]) + body
    clock = ClockField("stamp")
    _, found = decode("a/A", text, [message], ["stamp"], clock)
    assert found.sure.all()
    assert got(found, 0) == expected("a/A", text, message, [("stamp",)], clock)


def test_a_truth_value_in_a_time_is_one_whatever_its_byte():
    text = "Stamp stamp\n===\nMSG: a/Stamp\nbool sec\nbool nanosec"
    message = bytes([0, 1, 0, 0, 2, 255])
    clock = ClockField("stamp")
    _, found = decode("a/A", text, [message], ["stamp"], clock)
    assert got(found, 0) == expected("a/A", text, message, [("stamp",)], clock)
    assert found.stamp_ns.tolist() == [1_000_000_001]


@pytest.mark.parametrize(
    "path", ["gap.real", "gap.imag", "count.numerator", "__dict__.gap", "coils.²", "coils." + "9" * 5000]
)
def test_paths_into_what_only_a_python_object_has_are_left_to_the_library(path):
    assert compile_cdr("a/A", b"float64 gap\nint8 count\nfloat64[2] coils", Wanted((tuple(path.split(".")),))) == ()


@pytest.mark.parametrize(
    "text",
    [
        "wstring name",
        "Inner inner",
        "A[] again",
        "time stamp",
        "float64",
        "\xff",
        "float64[1000000000000000] long",
        "Inner[9999] inner\n===\nMSG: a/Inner\nuint8 a\nuint8 b",
    ],
)
def test_a_schema_that_cannot_be_unfolded_has_no_decoder(text):
    assert compile_cdr("a/A", text.encode("latin-1"), Wanted((("name",),))) == ()


def test_a_wild_unit_of_the_clock_is_left_to_the_library():
    for unit in (float("nan"), float("inf"), 1e300):
        assert compile_cdr("a/A", b"float64 t", Wanted((), ClockField("t", unit))) == ()


def test_no_messages_and_no_paths():
    _, found = decode("a/State", STATE, [], ["gap"], ClockField("stamp"))
    assert found.values.shape == (1, 0)
    _, found = decode("a/State", STATE, [state(), b""], [])
    assert found.values.shape == (0, 2)
    assert found.stamp_ns is None
    assert found.sure.tolist() == [True, False]


def test_payloads_that_do_not_lie_in_the_buffer_are_not_sure():
    (decoder,) = compile_cdr("a/A", b"float64 gap", Wanted((("gap",),)))
    data = np.frombuffer(bytes([0, 1, 0, 0]) + bytes(8), dtype=np.uint8)
    start = np.array([0, 1, -1, 2**62, 0], dtype=np.int64)
    length = np.array([12, 12, 12, 12, 2**62], dtype=np.int64)
    assert decoder.decode(Payloads(data, start, length)).sure.tolist() == [True, False, False, False, False]


def test_a_recorded_log_is_read_as_by_the_library(levitador):
    with (levitador / "constant_ros2.mcap").open("rb") as file:
        messages = list(make_reader(file).iter_messages())
    schema = messages[0][0]
    encoded = [message.data for _, _, message in messages]
    names = ["t", "y", "y_obs", "dy_obs", "i", "u", "yd"]
    decoder, found = decode(schema.name, schema.data.decode(), encoded, names, ClockField("t"))
    assert decoder.rung == "fixed_layout"
    assert found.sure.all()
    one = library(schema.name, schema.data.decode())
    contents = [one(message) for message in encoded]
    rows = np.array([[getattr(content, name) for name in names] for content in contents])
    assert found.values.T.tobytes() == rows.tobytes()
    assert found.stamp_ns.tolist() == [clock_ns(content.t, 1e9) for content in contents]
