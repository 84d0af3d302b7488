import importlib.util
import io
from contextlib import redirect_stderr
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import _for_each_msgdef

from maglev_offline.logs.decode.ros2_definitions import (
    Listed,
    Primitive,
    Struct,
    Text,
    read_definitions,
    read_message_type,
)

_spec = importlib.util.spec_from_file_location("ros2_messages", Path(__file__).with_name("ros2_messages.py"))
ros2 = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(ros2)

F8, U4 = Primitive("f8"), Primitive("u4")
TIME = Struct((("sec", U4), ("nanosec", U4)))


def members(text, name="magnets/msg/State"):
    return dict(read_message_type(name, text.encode()).members)


def as_the_library(text):
    """(name, kind, listed, count) of each member by type, as the library's parser has them; None if it refuses."""
    found = {}

    def keep(full, short, definition):
        fields = []
        for field in definition.fields:
            kind = field.type
            base = kind.type if kind.is_primitive_type() else f"{kind.pkg_name}/{kind.type}"
            fixed = kind.array_size if kind.is_fixed_size_array() else None
            fields.append((field.name, base, kind.is_array, fixed))
        found[full] = found[short] = fields

    try:
        with redirect_stderr(io.StringIO()):
            _for_each_msgdef("magnets/msg/State", text, keep)
    except Exception:
        return None
    return found


def as_read(text):
    try:
        definitions = read_definitions("magnets/msg/State", text)
    except ValueError:
        return None
    found = {}
    for name, (package, declared) in definitions.items():
        full = [f"{package}/{m.kind}" if m.kind[0].isupper() and "/" not in m.kind else m.kind for m in declared]
        found[name] = [(m.name, kind, m.listed, m.count) for m, kind in zip(declared, full, strict=True)]
    return found


def test_numbers_strings_arrays_and_sequences_keep_their_order():
    text = (
        """# what a magnet says of itself
        """.strip()
        + """
float64 gap 0.01          # with a default
bool on
byte raw
char letter
string name "left # 1"
string<=10 short
int32[3] three
uint8[<=4] at_most_four
float32[] any
string[2] names
"""
    )
    assert list(members(text).items()) == [
        ("gap", F8),
        ("on", Primitive("b1")),
        ("raw", Primitive("u1")),
        ("letter", Primitive("i1")),
        ("name", Text()),
        ("short", Text()),
        ("three", Listed(Primitive("i4"), 3)),
        ("at_most_four", Listed(Primitive("u1"), None)),
        ("any", Listed(Primitive("f4"), None)),
        ("names", Listed(Text(), 2)),
    ]


def test_constants_comments_and_empty_lines_are_no_members():
    assert members("int8 OFF=0\nint8 ON = 1\n\n  # nothing\nfloat64 gap\r\nstring S=a=b\n") == {"gap": F8}


def test_types_are_found_by_full_name_and_within_their_package():
    text = (
        "Inner a\nother_msgs/Inner b\n"
        "=====\nMSG: magnets/msg/Inner\nfloat64 x\n"
        "=====\nMSG: other_msgs/Inner\nDeep y\n"
        "=====\nMSG: other_msgs/Deep\nuint32 z\n"
    )
    deep = Struct((("y", Struct((("z", U4),))),))
    assert members(text) == {"a": Struct((("x", F8),)), "b": deep}


def test_times_are_known_unless_the_schema_brings_its_own():
    line = "builtin_interfaces/Time stamp\nbuiltin_interfaces/Duration age\n"
    assert members(line) == {"stamp": TIME, "age": TIME}
    own = line + "===\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    assert members(own) == {"stamp": Struct((("sec", Primitive("i4")), ("nanosec", U4))), "age": TIME}


def test_a_header_without_its_package_is_one_of_the_own_package_as_in_the_library():
    header = "===\nMSG: std_msgs/Header\nstring frame_id\n"
    assert members("Header header\n" + header, "std_msgs/State") == {"header": Struct((("frame_id", Text()),))}
    with pytest.raises(ValueError, match="magnets/Header"):
        members("Header header\n" + header)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("float64", "no field"),
        (" float64 x\n float64 y", "no field"),
        ("float64 Gap", "no field"),
        ("float64 x\nfloat64 x", "no field"),
        ("float64[0] x", "no array"),
        ("float64[9999999999999] x", "no array"),
        ("float64<=3 x", "only strings"),
        ("a/msg/B x", "no field"),
        ("Unknown x", "not defined"),
        ("State x", "holds itself"),
        ("A x\n===\nMSG: magnets/A\nB[] x\n===\nMSG: magnets/B\nA[] x", "holds itself"),
        ("wstring x", "does not decode"),
        ("time x", "does not decode"),
        ("MSG: other Name x\nfloat64 x", "no field"),
    ],
)
def test_what_cannot_be_read_is_told(text, said):
    with pytest.raises(ValueError, match=said):
        members(text)


def test_the_schema_must_define_its_message():
    with pytest.raises(ValueError, match="does not define"):
        members("MSG: other/Name\nfloat64 x")


def test_types_may_not_lie_too_deep_nor_unfold_without_end():
    def nest(depth, times):
        sections = [
            "\n".join([*(f"T{k} x{n}" for n in range(times)), f"===\nMSG: magnets/T{k}"]) for k in range(1, depth + 1)
        ]
        return "\n".join([*sections, "float64 x"])

    assert members(nest(30, 1))
    with pytest.raises(ValueError, match="deep"):
        members(nest(40, 1))
    with pytest.raises(ValueError, match="too many fields"):
        members(nest(30, 2))
    with pytest.raises(ValueError, match="too many fields"):
        members("\n".join(f"float64 x{k}" for k in range(10_001)))
    with pytest.raises(ValueError, match="too long"):
        members("#" * 4_000_001)


@settings(deadline=None, max_examples=100)
@given(ros2.message_types())
def test_definitions_are_read_as_by_the_library(types):
    text = ros2.schema_text(types)
    theirs, ours = as_the_library(text), as_read(text)
    assert {name: ours[name] for name in theirs} == theirs


LINES = [
    "float64 x", "string<=3 y", "int32[<=2] z", "uint8[3] w", "===", "=====", "MSG: magnets/A", "MSG: b/msg/A", "A a",
    "b/A ba", "int8 K=1", "int8 k =1", "float64 d 1.0", "string s 'a b'", "# c", " # c", "", "\tfloat64 t",
    "float64\tu", "MSG:  magnets/A", "MSG: magnets/A ", "=== ", "string q \"=\"", "int8[] e []", "float64 x # [m]",
    "MSG:", "x",
]  # fmt: skip


@settings(deadline=None, max_examples=300)
@given(st.lists(st.sampled_from(LINES), max_size=9), st.sampled_from(["\n", "\r\n", "\x0b"]))
@example(["float64 x", "==="], "\n")
def test_of_odd_definitions_those_that_are_read_are_read_as_by_the_library(lines, newline):
    text = newline.join(lines)
    theirs, ours = as_the_library(text), as_read(text)
    if theirs is not None and ours is not None:
        assert {name: ours[name] for name in theirs} == theirs


@settings(deadline=None, max_examples=200)
@given(st.text(max_size=60) | st.lists(st.sampled_from(LINES), max_size=6).map("\n".join))
def test_no_text_makes_the_reader_fail_in_another_way(text):
    try:
        read_message_type("magnets/msg/State", text.encode())
    except ValueError:
        return
