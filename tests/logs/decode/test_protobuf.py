import random
import struct
from typing import NamedTuple

import numpy as np
import pytest
from google.protobuf import timestamp_pb2
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Schema

from maglev_offline.logs.decode.library import UNDECODABLE, ClockField, Decoders, clock_ns, number, value_at
from maglev_offline.logs.decode.payloads import NO_TIME, Payloads, Wanted
from maglev_offline.logs.decode.protobuf import compile_protobuf
from maglev_offline.logs.schema_fields import declared_fields

F = FieldDescriptorProto
STAMP = ".google.protobuf.Timestamp"


class Described(NamedTuple):
    """A message type, its class in the library, and the schema as a log holds it."""

    made: type
    name: str
    schema: bytes


def described(message: DescriptorProto, syntax: str = "proto3", *more: DescriptorProto) -> Described:
    """The type in a file of package `t`, which may name the well-known Timestamp."""
    stamp = FileDescriptorProto()
    stamp.ParseFromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    file = FileDescriptorProto(name="t.proto", package="t", syntax=syntax, dependency=[stamp.name])
    file.message_type.extend([message, *more])
    pool = DescriptorPool()
    pool.Add(stamp)
    pool.Add(file)
    schema = FileDescriptorSet(file=[stamp, file]).SerializeToString()
    return Described(GetMessageClass(pool.FindMessageTypeByName(f"t.{message.name}")), f"t.{message.name}", schema)


def simple(*fields: tuple, syntax: str = "proto3") -> Described:
    """A type `M` of fields (name, number, type, label or None, type name or None)."""
    message = DescriptorProto(name="M")
    for name, at, kind, label, type_name in fields:
        message.field.add(name=name, number=at, type=kind, label=label or F.LABEL_OPTIONAL, type_name=type_name)
    return described(message, syntax)


def laid_out(payloads: list[bytes], after: int = 0) -> Payloads:
    """The payloads behind record headers of 31 bytes that look like a field, and `after` bytes behind the last."""
    parts, start = [], []
    at = 0
    for payload in payloads:
        parts += [b"\x09" * 31, payload]
        start.append(at + 31)
        at += 31 + len(payload)
    data = np.frombuffer(b"".join([*parts, b"\x09" * after]), dtype=np.uint8)
    return Payloads(data, np.array(start, dtype=np.int64), np.array([len(p) for p in payloads], dtype=np.int64))


def read_by(decoder, wanted, payload):
    """Bits of the numbers, and the stamp, as the library reads them; None where it cannot."""
    try:
        content = decoder(payload)
        bits = [struct.pack("<d", number(value_at(content, path))) for path in wanted.paths]
        clock = wanted.clock
        stamp = clock_ns(value_at(content, clock.path.split(".")), clock.ns_per_unit) if clock else None
    except UNDECODABLE:
        return None
    return bits, NO_TIME if stamp is None else stamp


def sure_rows(kind: Described, wanted: Wanted, payloads: Payloads) -> list[bool]:
    """Decode; every row that is sure must be what the library reads."""
    channel = Channel(id=1, schema_id=1, topic="/t", message_encoding="protobuf", metadata={})
    decoder = Decoders().of(channel, Schema(id=1, name=kind.name, encoding="protobuf", data=kind.schema))
    (cursor,) = compile_protobuf(kind.name, kind.schema, wanted)
    read = cursor.decode(payloads)
    assert read.values.shape == (len(wanted.paths), len(payloads))
    for row in np.flatnonzero(read.sure):
        stamp = NO_TIME if read.stamp_ns is None else int(read.stamp_ns[row])
        mine = [struct.pack("<d", v) for v in read.values[:, row].tolist()], stamp
        assert mine == read_by(decoder, wanted, payloads.of(row)), (row, payloads.of(row).hex())
    return read.sure.tolist()


def paths(*dotted: str) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(p.split(".")) for p in dotted)


# ---- random types ----

SCALARS = (
    F.TYPE_DOUBLE,
    F.TYPE_FLOAT,
    F.TYPE_INT64,
    F.TYPE_UINT64,
    F.TYPE_INT32,
    F.TYPE_FIXED64,
    F.TYPE_FIXED32,
    F.TYPE_BOOL,
    F.TYPE_STRING,
    F.TYPE_BYTES,
    F.TYPE_UINT32,
    F.TYPE_SFIXED32,
    F.TYPE_SFIXED64,
    F.TYPE_SINT32,
    F.TYPE_SINT64,
)
PACKABLE = tuple(k for k in SCALARS if k not in (F.TYPE_STRING, F.TYPE_BYTES))
MAP_KEYS = (F.TYPE_STRING, F.TYPE_INT32, F.TYPE_BOOL, F.TYPE_FIXED64, F.TYPE_SINT64)
numbers = st.lists(
    st.one_of(st.integers(1, 20), st.integers(1, 3000), st.integers(20000, 2**29 - 1)), unique=True, min_size=8
)


@st.composite
def messages(draw, name: str, syntax: str, above: str, depth: int) -> DescriptorProto:
    """A message type with the fields a to h at most, types of its own inside, in any order of numbers."""
    message = DescriptorProto(name=name)
    full = f"{above}.{name}"
    mode = message.enum_type.add(name="Mode")
    for k in (0, 1, 7):
        mode.value.add(name=f"{name.upper()}_{k}", number=k)
    shapes = ["one", "one", "one", "optional", "repeated", "oneof", "map", "packed"]
    for letter, at in zip("abcdefgh"[: draw(st.integers(1, 8))], draw(numbers), strict=False):
        shape = draw(st.sampled_from([*shapes, "required"] if syntax == "proto2" else shapes))
        field = message.field.add(name=letter, number=at, label=F.LABEL_OPTIONAL, type=draw(st.sampled_from(SCALARS)))
        if shape == "packed":
            field.type, field.label = draw(st.sampled_from(PACKABLE)), F.LABEL_REPEATED
            field.options.packed = draw(st.booleans())
        if shape == "map":
            entry = message.nested_type.add(name=f"{letter.upper()}Entry")
            entry.options.map_entry = True
            entry.field.add(name="key", number=1, label=F.LABEL_OPTIONAL, type=draw(st.sampled_from(MAP_KEYS)))
            entry.field.add(name="value", number=2, label=F.LABEL_OPTIONAL, type=field.type)
            field.type, field.label, field.type_name = F.TYPE_MESSAGE, F.LABEL_REPEATED, f"{full}.{entry.name}"
            continue
        match draw(st.sampled_from(["scalar", "scalar", "scalar", "enum", "stamp", "message"])):
            case "enum":
                field.type, field.type_name = F.TYPE_ENUM, f"{full}.Mode"
            case "stamp" if shape != "packed":
                field.type, field.type_name = F.TYPE_MESSAGE, STAMP
            case "message" if shape != "packed" and depth:
                inner = draw(messages(f"In{letter}", syntax, full, depth - 1))
                message.nested_type.append(inner)
                field.type, field.type_name = F.TYPE_MESSAGE, f"{full}.{inner.name}"
        if shape == "repeated":
            field.label = F.LABEL_REPEATED
        elif shape == "required":
            field.label = F.LABEL_REQUIRED
        elif shape == "oneof":
            if not message.oneof_decl:
                message.oneof_decl.add(name="either")
            field.oneof_index = 0
    if syntax == "proto3":
        for field in message.field:
            if field.label == F.LABEL_OPTIONAL and not field.HasField("oneof_index") and draw(st.booleans()):
                field.proto3_optional = True
                field.oneof_index = len(message.oneof_decl)
                message.oneof_decl.add(name=f"_{field.name}")
    return message


@st.composite
def kinds(draw) -> Described:
    syntax = draw(st.sampled_from(["proto3", "proto2"]))
    return described(draw(messages("M", syntax, ".t", 2)), syntax)


DOUBLES = [0.0, -0.0, 1.5, -3.25e-300, float("inf"), float("nan"), struct.unpack("<d", b"\x01\0\0\0\0\0\xf0\xff")[0]]
TEXTS = ["", "gap", "µm", "a text of more than sixteen bytes", "x" * 70, "é" * 40, "0123456789abcdef"]
WHOLE = [0, 1, -1, 127, 128, 300, 2**31 - 1, -(2**31), 2**32 - 1, 2**53 + 1, 2**63 - 1, -(2**63), 2**64 - 1, 10**9]


def value_of(field, dice: random.Random):
    """A value that the field can hold, often one at an edge."""
    match field.type:
        case F.TYPE_DOUBLE:
            return dice.choice([*DOUBLES, dice.gauss(0, 1)])
        case F.TYPE_FLOAT:
            return dice.choice([0.0, -0.0, 0.1, 3e38, float("inf"), float("nan")])
        case F.TYPE_BOOL:
            return dice.random() < 0.5
        case F.TYPE_STRING:
            return dice.choice(TEXTS)
        case F.TYPE_BYTES:
            return dice.choice(TEXTS).encode("utf-16")
        case F.TYPE_ENUM:
            return dice.choice([0, 1, 7] if field.enum_type.is_closed else [0, 1, 7, 99, -1])
    signed = field.type not in (F.TYPE_UINT64, F.TYPE_UINT32, F.TYPE_FIXED64, F.TYPE_FIXED32)
    bits = 64 if field.cpp_type in (field.CPPTYPE_INT64, field.CPPTYPE_UINT64) else 32
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return dice.choice([w for w in [*WHOLE, dice.randint(low, high)] if low <= w <= high])


def fill(message, dice: random.Random) -> None:
    for field in message.DESCRIPTOR.fields:
        must = field.is_required
        if not must and dice.random() < 0.3:
            continue
        held = getattr(message, field.name)
        if field.message_type is not None and field.message_type.GetOptions().map_entry:
            key, value = field.message_type.fields
            for _ in range(dice.randint(0, 3)):
                held_key = value_of(key, dice)
                if value.message_type is None:
                    held[held_key] = value_of(value, dice)
        elif field.message_type is not None:
            if field.is_repeated:
                for _ in range(dice.randint(0, 3)):
                    fill(held.add(), dice)
            else:
                held.SetInParent()
                if field.message_type.full_name == STAMP[1:] and dice.random() < 0.8:
                    held.seconds, held.nanos = dice.choice([0, 1_700_000_000, -5]), dice.choice([0, 1, 999_999_999])
                else:
                    fill(held, dice)
        elif field.is_repeated:
            held.extend(value_of(field, dice) for _ in range(dice.randint(0, 4)))
        else:
            setattr(message, field.name, value_of(field, dice))


def wanted_of(kind: Described, dice: random.Random) -> Wanted:
    """Every declared path and time, lists by their first and third element, and one of them as the clock."""
    found = declared_fields("protobuf", kind.name, kind.schema)
    dotted = [p for d in (*found.numbers, *found.times) for p in dict.fromkeys([d.replace("*", k) for k in "02"])]
    dotted += ["a", "b", "nowhere"]
    dotted += [f"{f.name}.nowhere" for f in kind.made.DESCRIPTOR.fields if f.message_type and not f.is_repeated]
    clock = ClockField(dice.choice(dotted), dice.choice([1e9, 1e6, 1.0, 0.5]))
    return Wanted(paths(*dotted), clock)


relaxed = settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.too_slow])


def a_time_out_of_range(message) -> bool:
    """Whether a time in it lies so far off that the cursor leaves it to the library."""
    if message.DESCRIPTOR.full_name == STAMP[1:]:
        return abs(message.seconds) > 9_000_000_000
    below = [(f, v) for f, v in message.ListFields() if f.message_type and not f.message_type.GetOptions().map_entry]
    return any(a_time_out_of_range(m) for f, v in below for m in (v if f.is_repeated else [v]))


@relaxed
@given(kinds(), st.integers(0, 2**32), st.sampled_from([0, 7, 100]))
def test_what_the_serialiser_writes_is_read_as_the_library_reads_it(kind, seed, after):
    dice = random.Random(seed)
    made = [kind.made() for _ in range(9)]
    for message in made:
        fill(message, dice)
    written = [m.SerializeToString(deterministic=True) for m in made]
    sure = sure_rows(kind, wanted_of(kind, dice), laid_out(written, after))
    assert all(s or a_time_out_of_range(m) for s, m in zip(sure, made, strict=True))


def damaged(payload: bytes, dice: random.Random) -> bytes:
    """The payload cut, flipped, longer, doubled or turned round."""
    at = dice.randrange(len(payload) + 1)
    match dice.randrange(7):
        case 0:
            return payload[:at]
        case 1 if at < len(payload):
            return payload[:at] + bytes([payload[at] ^ 1 << dice.randrange(8)]) + payload[at + 1 :]
        case 2:
            return payload + dice.choice([b"\xf8\x3f\x01", b"\x00", b"\x0b\x0c", b"\x0a\xff\xff\xff\xff\x0f", b"\x80"])
        case 3:
            return payload + payload
        case 4:
            return payload[at:] + payload[:at]
        case 5:
            return payload[:at] + bytes(dice.randrange(256) for _ in range(dice.randrange(12))) + payload[at:]
    return payload[:at] + b"\x80" * dice.randrange(12) + payload[at:]


@relaxed
@given(kinds(), st.integers(0, 2**32), st.sampled_from([0, 100]))
def test_damaged_messages_are_not_sure_or_read_as_the_library_reads_them(kind, seed, after):
    dice = random.Random(seed)
    written = []
    for _ in range(20):
        message = kind.made()
        fill(message, dice)
        written.append(damaged(message.SerializeToString(deterministic=True), dice))
    sure_rows(kind, wanted_of(kind, dice), laid_out(written, after))


# ---- one thing at a time ----

DOUBLE, UINT32 = F.TYPE_DOUBLE, F.TYPE_UINT32


def read(kind: Described, wanted: Wanted, *payloads: bytes):
    """What is found, checked against the library where it is sure."""
    sure_rows(kind, wanted, laid_out(list(payloads)))
    return compile_protobuf(kind.name, kind.schema, wanted)[0].decode(laid_out(list(payloads)))


def test_a_zero_that_is_left_out_is_zero_and_a_field_with_presence_is_missing():
    three = simple(("gap", 1, DOUBLE, None, None), ("n", 2, UINT32, None, None))
    two = simple(("gap", 1, DOUBLE, None, None), ("n", 2, UINT32, None, None), syntax="proto2")
    wanted = Wanted(paths("gap", "n"), ClockField("n"))
    assert read(three, wanted, b"").values.tolist() == [[0.0], [0.0]]
    assert read(three, wanted, b"").stamp_ns.tolist() == [0]
    assert np.isnan(read(two, wanted, b"").values).all()
    assert read(two, wanted, b"").stamp_ns.tolist() == [NO_TIME]


def test_only_the_rows_that_do_not_fit_are_left_to_the_library():
    kind = simple(("gap", 1, DOUBLE, None, None), ("n", 2, UINT32, None, None))
    good = kind.made(gap=0.015, n=3).SerializeToString()
    gap, n = good[:9], good[9:]
    rows = {
        "good": good,
        "unknown field": good + b"\x18\x01",
        "turned round": n + gap,
        "twice": gap + gap + n,
        "cut": good[:-1],
        "cut in the gap": good[:5],
        "wrong wire type": gap + b"\x15\x01\0\0\0",
        "group": b"\x0b\x0c",
        "field zero": good + b"\x00",
        "varint too long": gap + b"\x10" + b"\xff" * 10 + b"\x01",
        "good again": good,
    }
    found = read(kind, Wanted(paths("gap", "n")), *rows.values())
    assert [name for name, sure in zip(rows, found.sure, strict=True) if sure] == ["good", "good again"]
    assert found.values[:, -1].tolist() == [0.015, 3.0]


def test_a_text_must_be_utf_8_as_the_library_demands_it():
    kind = simple(("frame", 1, F.TYPE_STRING, None, None), ("gap", 2, DOUBLE, None, None))
    texts = [b"magnet", "µ" * 9, "", b"\xff", b"abcdefgh\xc3", b"x" * 64, b"x" * 64 + b"\xed\xa0\x80", b"y" * 300]
    coded = [t.encode() if isinstance(t, str) else t for t in texts]
    length = [bytes([len(t)]) if len(t) < 128 else bytes([len(t) & 127 | 128, len(t) >> 7]) for t in coded]
    payloads = [
        b"\x0a" + size + t + kind.made(gap=2.0).SerializeToString() for size, t in zip(length, coded, strict=True)
    ]
    sure = sure_rows(kind, Wanted(paths("gap", "frame")), laid_out(payloads))
    assert sure == [True, True, True, False, False, True, False, True]


def test_a_value_that_a_closed_enum_does_not_know_is_not_sure():
    message = DescriptorProto(name="M")
    mode = message.enum_type.add(name="Mode")
    for k in (2, -1):
        mode.value.add(name=f"MODE_{k + 1}", number=k)
    message.field.add(name="mode", number=1, type=F.TYPE_ENUM, type_name=".t.M.Mode", label=F.LABEL_OPTIONAL)
    kind = described(message, "proto2")
    minus_one = b"\x08" + b"\xff" * 9 + b"\x01"
    assert sure_rows(kind, Wanted(paths("mode")), laid_out([b"\x08\x02", b"\x08\x03", minus_one])) == [
        True,
        False,
        True,
    ]


def test_the_second_field_of_a_oneof_takes_back_the_first():
    message = DescriptorProto(name="M")
    message.oneof_decl.add(name="either")
    for at, name in enumerate(("gap", "force"), start=1):
        message.field.add(name=name, number=at, type=DOUBLE, label=F.LABEL_OPTIONAL, oneof_index=0)
    kind = described(message)
    gap, force = kind.made(gap=1.0).SerializeToString(), kind.made(force=2.0).SerializeToString()
    assert sure_rows(kind, Wanted(paths("gap", "force")), laid_out([gap, force, gap + force, b""])) == [
        True,
        True,
        False,
        True,
    ]


def test_a_message_without_a_required_field_is_left_to_the_library():
    kind = simple(("gap", 1, DOUBLE, F.LABEL_REQUIRED, None), ("n", 2, UINT32, F.LABEL_REQUIRED, None), syntax="proto2")
    whole = kind.made(gap=1.0, n=1).SerializeToString()
    assert sure_rows(kind, Wanted(paths("gap")), laid_out([whole, whole[:9], b""])) == [True, False, False]


@pytest.mark.parametrize(("whole", "rest"), [("sec", "nanosec"), ("secs", "nsecs"), ("seconds", "nanos")])
def test_two_parts_make_a_time_and_a_part_left_out_has_its_default(whole, rest):
    message = DescriptorProto(name="M")
    message.field.add(name=whole, number=1, type=F.TYPE_SINT64, label=F.LABEL_OPTIONAL, default_value="7")
    message.field.add(name=rest, number=2, type=UINT32, label=F.LABEL_OPTIONAL)
    outer = DescriptorProto(name="N")
    outer.field.add(name="stamp", number=1, type=F.TYPE_MESSAGE, type_name=".t.M", label=F.LABEL_OPTIONAL)
    kind = described(outer, "proto2", message)
    full, half, none = kind.made(), kind.made(), kind.made()
    setattr(full.stamp, whole, -3)
    setattr(full.stamp, rest, 500_000_000)
    half.stamp.SetInParent()
    wanted = Wanted(paths("stamp", f"stamp.{whole}"), ClockField("stamp"))
    found = read(kind, wanted, *(m.SerializeToString() for m in (full, half, none)))
    assert found.sure.all()
    assert found.stamp_ns.tolist() == [-2_500_000_000, 7_000_000_000, NO_TIME]
    assert found.values[0, :2].tolist() == [-2.5, 7.0]
    assert np.isnan(found.values[1, 1:]).all()


def test_a_group_is_read_by_the_library():
    message = DescriptorProto(name="M")
    message.nested_type.add(name="Pose").field.add(name="z", number=1, type=DOUBLE, label=F.LABEL_OPTIONAL)
    message.field.add(name="pose", number=1, type=F.TYPE_GROUP, type_name=".t.M.Pose", label=F.LABEL_OPTIONAL)
    message.field.add(name="gap", number=2, type=DOUBLE, label=F.LABEL_OPTIONAL)
    kind = described(message, "proto2")
    with_group = kind.made(gap=1.0)
    with_group.pose.z = 3.0
    payloads = [with_group.SerializeToString(), kind.made(gap=1.0).SerializeToString()]
    assert sure_rows(kind, Wanted(paths("gap", "pose.z")), laid_out(payloads)) == [False, True]


def tree() -> Described:
    """A message that holds messages of its own type."""
    message = DescriptorProto(name="M")
    message.field.add(name="gap", number=1, type=DOUBLE, label=F.LABEL_OPTIONAL)
    message.field.add(name="next", number=2, type=F.TYPE_MESSAGE, type_name=".t.M", label=F.LABEL_OPTIONAL)
    message.field.add(name="all", number=3, type=F.TYPE_MESSAGE, type_name=".t.M", label=F.LABEL_REPEATED)
    return described(message)


def test_a_type_may_hold_itself_to_a_bounded_depth():
    kind = tree()
    payloads = []
    for depth in (1, 4, 30, 60, 500):
        inside = b"\x09" + struct.pack("<d", 4.0)
        for _ in range(depth):
            size = len(inside)
            inside = b"\x12" + (bytes([size]) if size < 128 else bytes([size & 127 | 128, size >> 7])) + inside
        payloads.append(inside)
    sure = sure_rows(kind, Wanted(paths("next.gap", "next.next.next.next.gap")), laid_out(payloads))
    assert sure == [True, True, True, False, False]


def test_a_list_goes_on_as_long_as_enough_rows_have_it():
    kind = tree()
    lists = [b"\x1a\x00" * k for k in (0, 1, 64, 65, 5000)]
    assert sure_rows(kind, Wanted(paths("all.0.gap")), laid_out(lists)) == [True, True, True, False, False]
    assert all(sure_rows(kind, Wanted(paths("all.99.gap")), laid_out([b"\x1a\x00" * 100] * 8, after=100)))


def test_the_work_is_bounded_whatever_a_payload_holds(monkeypatch):
    monkeypatch.setattr("maglev_offline.logs.decode.protobuf.STEPS", 100)
    many = [b"\x1a\x00" * 60] * 10
    assert not any(sure_rows(tree(), Wanted(paths("gap")), laid_out(many)))
    assert all(sure_rows(tree(), Wanted(paths("gap")), laid_out([b"\x1a\x00"] * 10)))


def test_a_packed_list_may_be_long():
    kind = simple(("force", 1, DOUBLE, F.LABEL_REPEATED, None), ("n", 2, F.TYPE_SINT32, F.LABEL_REPEATED, None))
    made = [kind.made(force=np.arange(k) / 3, n=range(-k // 8, 0)) for k in (0, 3, 400)]
    wanted = Wanted(paths("force.0", "force.2", "force.399", "force.400", "n.0", "n.49", "force", "n"))
    found = read(kind, wanted, *(m.SerializeToString() for m in made))
    assert found.sure.all()
    assert found.values[2, 2] == 133.0
    assert found.values[4:6, 2].tolist() == [-50.0, -1.0]


def test_a_packed_list_must_end_where_it_says():
    kind = simple(("force", 1, DOUBLE, F.LABEL_REPEATED, None), ("n", 2, F.TYPE_UINT64, F.LABEL_REPEATED, None))
    wanted = Wanted(paths("force.0", "n.0"))
    rows = [b"\x0a\x08" + bytes(8), b"\x0a\x09" + bytes(9), b"\x12\x02\x81\x01", b"\x12\x02\x01\x81", b"\x12\x01\x81"]
    assert sure_rows(kind, wanted, laid_out(rows, after=50)) == [True, False, True, False, False]


def test_a_varint_of_more_than_64_bits_is_left_to_the_library():
    kind = simple(("n", 1, F.TYPE_UINT64, None, None))
    rows = [b"\x08" + b"\xff" * 9 + last for last in (b"\x01", b"\x02")]
    assert sure_rows(kind, Wanted(paths("n")), laid_out(rows)) == [True, False]


def test_the_bits_of_a_nan_are_kept():
    kind = simple(("gap", 1, DOUBLE, None, None), ("force", 2, F.TYPE_FLOAT, None, None))
    payload = b"\x09\x34\x12\0\0\0\0\xf0\x7f" + b"\x15\x01\0\x80\x7f"
    assert sure_rows(kind, Wanted(paths("gap", "force")), laid_out([payload])) == [True]


def test_places_that_are_not_in_the_buffer_are_not_sure():
    kind = simple(("gap", 1, DOUBLE, None, None))
    payload = kind.made(gap=1.0).SerializeToString()
    data = np.frombuffer(payload * 2, dtype=np.uint8)
    start = np.array([0, 9, -1, 10, 18, 19, 3, 2**62, 9], dtype=np.int64)
    length = np.array([9, 9, 9, 9, 0, 0, -3, 2**62, 2**63 - 1], dtype=np.int64)
    found = compile_protobuf(kind.name, kind.schema, Wanted(paths("gap")))[0].decode(Payloads(data, start, length))
    assert found.sure.tolist() == [True, True, False, False, True, False, False, False, False]
    assert found.values[0, [0, 1, 4]].tolist() == [1.0, 1.0, 0.0]


def test_no_messages_are_no_columns():
    kind = simple(("gap", 1, DOUBLE, None, None))
    found = compile_protobuf(kind.name, kind.schema, Wanted(paths("gap"), ClockField("gap")))[0].decode(laid_out([]))
    assert found.values.shape == (1, 0)
    assert found.stamp_ns.shape == (0,)


@pytest.mark.parametrize("path", ["gap.real", "blob.0", "force.x", "force.²", "names.key"])
def test_a_path_where_python_has_its_own_ways_is_left_to_the_library(path):
    message = DescriptorProto(name="M")
    message.field.add(name="gap", number=1, type=DOUBLE, label=F.LABEL_OPTIONAL)
    message.field.add(name="blob", number=2, type=F.TYPE_BYTES, label=F.LABEL_OPTIONAL)
    message.field.add(name="force", number=3, type=DOUBLE, label=F.LABEL_REPEATED)
    entry = message.nested_type.add(name="NamesEntry")
    entry.options.map_entry = True
    for at, name in enumerate(("key", "value"), start=1):
        entry.field.add(name=name, number=at, label=F.LABEL_OPTIONAL, type=F.TYPE_STRING)
    message.field.add(name="names", number=4, type=F.TYPE_MESSAGE, type_name=".t.M.NamesEntry", label=F.LABEL_REPEATED)
    kind = described(message)
    assert compile_protobuf(kind.name, kind.schema, Wanted(paths(path))) == ()
    assert len(compile_protobuf(kind.name, kind.schema, Wanted(paths("gap")))) == 1


@settings(deadline=None)
@given(st.binary(max_size=200), st.integers(0, 400), st.booleans())
def test_a_schema_that_cannot_be_read_serves_nothing(noise, at, mix):
    kind = simple(("gap", 1, DOUBLE, None, None))
    schema = kind.schema[:at] + noise + kind.schema[at:] if mix else noise
    assert len(compile_protobuf("t.M", schema, Wanted(paths("gap")))) <= 1
    assert compile_protobuf("t.Other", kind.schema, Wanted(paths("gap"))) == ()


def test_a_schema_that_is_too_large_serves_nothing():
    wide = simple(*((f"f{k}", k + 1, DOUBLE, None, None) for k in range(4097)))
    assert compile_protobuf(wide.name, wide.schema, Wanted(paths("f0"))) == ()
    few = simple(("f0", 1, DOUBLE, None, None))
    unknown_field = b"\xfa\x3f" + b"\x80\x80\x80\x08" + bytes(16 * 2**20)
    assert len(compile_protobuf(few.name, few.schema, Wanted(paths("f0")))) == 1
    assert compile_protobuf(few.name, few.schema + unknown_field, Wanted(paths("f0"))) == ()


def test_files_that_need_each_other_serve_nothing():
    files = [FileDescriptorProto(name=a, package="t", dependency=[b]) for a, b in (("a", "b"), ("b", "a"))]
    assert compile_protobuf("t.M", FileDescriptorSet(file=files).SerializeToString(), Wanted(paths("gap"))) == ()


def test_recorded_messages_are_all_read_by_the_cursor(levitador):
    with (levitador / "sine_protobuf.mcap").open("rb") as file:
        recorded = list(make_reader(file).iter_messages())
    schema = recorded[0][0]
    wanted = Wanted(paths("t", "y", "y_obs", "dy_obs", "i", "u", "yd"), ClockField("t"))
    (cursor,) = compile_protobuf(schema.name, schema.data, wanted)
    decoder = Decoders().of(recorded[0][1], schema)
    found = cursor.decode(laid_out([m.data for _, _, m in recorded]))
    assert found.sure.all()
    bits = [[struct.pack("<d", v) for v in row] for row in found.values.T.tolist()]
    stamps = found.stamp_ns.tolist()
    assert list(zip(bits, stamps, strict=True)) == [read_by(decoder, wanted, m.data) for _, _, m in recorded]
