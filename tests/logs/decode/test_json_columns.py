"""Both decoders of JSON columns against the library, row for row and bit for bit."""

import json
import math
import time
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from maglev_offline.logs.decode.json_by_arrow import ArrowJson
from maglev_offline.logs.decode.json_by_template import TemplateJson
from maglev_offline.logs.decode.json_columns import compile_json
from maglev_offline.logs.decode.library import UNDECODABLE, ClockField, clock_ns, number, value_at
from maglev_offline.logs.decode.payloads import NO_TIME, Payloads, Wanted

BOTH = (TemplateJson, ArrowJson)
HEADER = b'\x05{"a":1},]\n\x00\xff' + b"}" * 18


def payloads_of(texts, gaps=(HEADER,)):
    """The texts one after another in a buffer, with something else before, between and after them."""
    parts, start, place = [], [], 0
    for row, text in enumerate(texts):
        gap = gaps[row % len(gaps)]
        parts += [gap, text]
        start.append(place + len(gap))
        place += len(gap) + len(text)
    data = np.frombuffer(b"".join([*parts, b"{,}"]), dtype=np.uint8)
    return Payloads(data, np.array(start, dtype=np.int64), np.array([len(text) for text in texts], dtype=np.int64))


@lru_cache(maxsize=4096)
def by_library(text, wanted):
    """Numbers and stamp of one message, None where it cannot be decoded."""
    try:
        message = json.loads(text)
        numbers = [number(value_at(message, path)) for path in wanted.paths]
        stamp = None
        if wanted.clock:
            stamp = clock_ns(value_at(message, wanted.clock.path.split(".")), wanted.clock.ns_per_unit)
    except UNDECODABLE:
        return None
    return np.array(numbers), NO_TIME if stamp is None else stamp


def checked(kind, texts, wanted, gaps=(HEADER,)):
    """Decode, compare all rows that are sure with the library, and return which are."""
    found = kind(wanted).decode(payloads_of(texts, gaps))
    assert found.values.shape == (len(wanted.paths), len(texts))
    for row in np.flatnonzero(found.sure):
        expected = by_library(texts[row], wanted)
        assert expected is not None, texts[row]
        numbers, stamp = expected
        same = (found.values[:, row].view(np.int64) == numbers.view(np.int64)) | (
            np.isnan(found.values[:, row]) & np.isnan(numbers)
        )
        assert same.all(), (texts[row], found.values[:, row], numbers)
        if wanted.clock:
            assert found.stamp_ns[row] == stamp, texts[row]
    return found.sure


def messages(n, **changes):
    """Alike in everything but the numbers."""
    rows = range(n)
    return [
        json.dumps(
            {
                "header": {"stamp": {"sec": 1_700_000_000 + k, "nanosec": 999_999_999 - k}, "frame_id": f"P{k}"},
                "seq": k,
                "gap_mm": 10 + math.sin(k),
                "magnets": [{"gap": -k / 7, "on": True}, {"gap": 1e-7 * k, "on": False}],
                "note": 'a "quoted", {strange} text\\',
                **changes,
            }
        ).encode()
        for k in rows
    ]


PATHS = (
    ("seq",),
    ("gap_mm",),
    ("magnets", "0", "gap"),
    ("magnets", "1", "gap"),
    ("magnets", "2", "gap"),
    ("header", "stamp", "nanosec"),
    ("absent",),
)
WANTED = Wanted(PATHS, ClockField("header.stamp"))


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("gaps", [(HEADER,), (HEADER, HEADER * 9), (b"}",)], ids=["alike", "mixed", "tight"])
def test_messages_that_are_alike_are_all_sure(kind, gaps):
    assert checked(kind, messages(200), WANTED, gaps).all()


@pytest.mark.parametrize("kind", BOTH)
def test_every_row_gets_its_own_numbers(kind):
    found = kind(Wanted((("seq",),))).decode(payloads_of(messages(20_000)))
    assert found.sure.all()
    assert found.values[0].tolist() == list(range(20_000))


@pytest.mark.parametrize("kind", BOTH)
def test_a_time_is_a_number_of_seconds_as_well(kind):
    assert checked(kind, messages(64), Wanted((("header", "stamp"), ("header", "stamp", "sec")))).all()


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("dump", [{"indent": 2}, {"separators": (",", ":")}, {"separators": (" ,  ", " :\t")}])
def test_blanks_and_newlines_are_allowed_where_json_allows_them(kind, dump):
    texts = [b" " + json.dumps(json.loads(text), **dump).encode() + b"\r\n" for text in messages(64)]
    sure = checked(kind, texts, WANTED)
    # With a blank before a comma there is no template.
    assert sure.all() or (kind is TemplateJson and " ,  " in dump["separators"])


@pytest.mark.parametrize("kind", BOTH)
def test_several_kinds_of_messages_may_share_a_schema(kind):
    texts = [text for pair in zip(messages(64), messages(64, extra="more"), strict=True) for text in pair]
    assert checked(kind, texts, WANTED).all()


@pytest.mark.parametrize("kind", BOTH)
def test_no_messages_and_no_wanted_fields(kind):
    assert checked(kind, [], WANTED).shape == (0,)
    checked(kind, messages(40), Wanted(()))


ODD_NUMBERS = """
0 -0 -0.0 0.0 1 -1 1.5 1e5 1E5 1e+5 1e-5 1.5E-07 -1e-400 1e-400 5e-324 2e-324 1e400 -1e400 1.7976931348623159e308
0e9 0e999999 1e-999999999999 9007199254740993 9223372036854775807 9223372036854775808 -9223372036854775808 0.1
18446744073709551616 123456789012345678901234567890.5 01 -01 00 1. .5 -.5 +1 1.e5 1e 1e+ 1e5.5 - -- --1 1-2 1_0
0x10 0X1F 1f 1d5 NaN -NaN nan Inf -Inf Infinity -Infinity +Infinity inf infinity nan(1) null true false True None
nul nulll "1" "" "NaN" "2020-01-01" [] {} [1] {"a":1} {"sec":1,"nanosec":2} {"sec":1.0,"nanosec":2}
{"secs":1,"nsecs":2} {"sec":true,"nanosec":2} {"sec":null,"nanosec":2} [1,] 1,1 1}{ "\\ud800" "\\udc00" "\\u0041"
"\\q" "\\" "a\\"b" /**/1 1/**/ 1//
"""
ODD_VALUES = [
    *(odd.encode() for odd in ODD_NUMBERS.split()),
    b"",
    b" 1 ",
    b"\n1\n",
    b"\x0c1",
    b"\x001",
    b"1\x00",
    b"1\x7f",
    b"\xef\xbb\xbf1",
    "１".encode(),
    b'"\xff"',
    b'"\xed\xa0\x80"',
    '"é"'.encode(),
    b'"tab\there"',
    b'"new\nline"',
    b'"nul\x00"',
    b"9" * 400,
    b"9" * 700,
    b"9" * 5000,
    b"0." + b"1" * 5000,
    b'1,"gap":2',
    b'1,"g\\u0061p":2',
    b'1}\n{"gap":2',
    b'"}\n{"',
    b"[" * 300 + b"]" * 300,
    b"[" * 1200 + b"]" * 1200,
    b'{"a":' * 1200 + b"1" + b"}" * 1200,
    b"[" * 100_000,
    b'["' + b"]" * 400 + b'",' + b"[" * 1200 + b"]" * 1200 + b"]",
    b'"' + b"{[" * 400 + b'"',
]
FORMS = {
    "wanted": (b'{"t":1,"gap":', b',"b":2}'),
    "last": (b'{"t":1,"b":2.5,"gap":', b"}"),
    "not wanted": (b'{"t":1,"gap":2.5,"b":', b"}"),
    "clock": (b'{"gap":2.5,"t":', b"}"),
    "in a list": (b'{"t":1,"gap":2,"list":[1,', b"]}"),
}
ODD_WANTED = Wanted((("gap",), ("list", "1"), ("t",)), ClockField("t"))


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("normal", [b"1", b"1.25", b'"text"'])
def test_an_odd_value_is_read_as_the_library_reads_it_or_not_sure(kind, form, normal):
    before, after = FORMS[form]
    for odd in ODD_VALUES:
        usual = [before + normal + after] * 8
        checked(kind, [*usual, before + odd + after, *usual], ODD_WANTED)
    checked(kind, [before + odd + after for odd in ODD_VALUES], ODD_WANTED)


ODD_TEXTS = [
    b"",
    b" ",
    b"{}",
    b"{}{}",
    b'{"gap":1}{"gap":2}',
    b'{"gap":1}\n{"gap":2}',
    b"[]",
    b"1",
    b'"{}"',
    b'\xef\xbb\xbf{"gap":1}',
    '{"gap":1}'.encode("utf-16"),
    '{"gap":1}'.encode("utf-16-le"),
    '{"gap":1}'.encode("utf-32-be"),
    b'{"gap":1',
    b'"gap":1}',
    b'{"gap":"}',
    b'{"',
    b'"}',
    b'{"gap":1}\x00{"gap":2}',
    b'\x00{"gap":1}',
    b'{"gap":1} // }',
    b'{"gap":1,}',
    b"{'gap':1}",
    b'{"gap"=1}',
    b'{"gap":1;"b":2}',
    b'{"gap":1}}',
    b'{{"gap":1}',
    b'{"gap":1,"gap":2}',
    b'{"g\\u0061p":1}',
    b'{"gap\\u0000":1}',
    b'{"t":{"sec":1,"nanosec":2,"sec":3}}',
    b'{"t":{"sec":4000000000,"nanosec":4611686018427387904}}',
    b'{"t":{"sec":-9223372036854775808,"nanosec":0}}',
    b'{"t":{"sec":1,"secs":2,"nsecs":3}}',
    b'{"t":{"secs":2,"nsecs":3,"sec":1,"nsec":5}}',
    b'{"t":{"seconds":2,"nanos":3}}',
    b'{"t":[1,2]}',
    b'{"list":null}',
    b'{"list":[]}',
    b'{"list":[null,null]}',
    b'{"list":{"1":5}}',
    b'{"list":[1,[2]]}',
]


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("odd", ODD_TEXTS, ids=lambda text: repr(text)[:40])
def test_an_odd_message_spoils_no_other(kind, odd):
    for usual in (b'{"t":1,"gap":2.5,"list":[1,2]}', b'{"t":{"sec":1,"nanosec":2},"gap":2.5,"list":[1,2,3]}'):
        texts = [usual] * 300
        for row in (0, 150):
            texts[row] = odd
        sure = checked(kind, texts, ODD_WANTED)
        alike = np.array([text == usual for text in texts])
        assert sure[alike].mean() > 0.8


@pytest.mark.parametrize("kind", BOTH)
@given(data=st.data())
@settings(deadline=None, max_examples=60)
def test_rows_that_make_up_for_each_other_are_not_confused(kind, data):
    """A row with two texts and one with none, or a text that goes on in the next row, keep the count right."""
    pieces = st.sampled_from(
        [
            b'{"gap":1}',
            b'{"gap":2}{"gap":3}',
            b"",
            b" ",
            b"{}",
            b'{"gap":',
            b"4}",
            b'{"gap":"}',
            b'{"}',
            b'"}',
            b'{"a":{',
        ]
    )
    checked(kind, data.draw(st.lists(pieces, min_size=16, max_size=40)), Wanted((("gap",),)))


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("unit", [1e9, 1e6, 1.0, 0.5, 1e-3, 123456.789, 1e19])
@pytest.mark.parametrize("stamps", ["integers", "floats", "both"])
def test_a_plain_number_as_stamp_loses_nothing(kind, unit, stamps):
    integers = [1_700_000_000_123_456_789, 9_007_199_254_740_993, 17, -5, 0, 9_223_372_036, 2**63 - 1, 2**70]
    floats = [1.7e9, 1700000000.1234567, 0.5, -0.0, 1e300, 2.5, 1.5, 9007199254740993.0, 9223372036.854776]
    chosen = {"integers": integers, "floats": floats, "both": integers + floats}[stamps]
    texts = [b'{"t":%s,"gap":1}' % json.dumps(stamp).encode() for stamp in chosen * 4]
    checked(kind, texts, Wanted((("t",),), ClockField("t", unit)))


@pytest.mark.parametrize("kind", BOTH)
def test_integers_as_stamps_are_sure(kind):
    texts = [b'{"t":%d,"gap":1.5}' % (1_700_000_000_123_456_789 + k) for k in range(100)]
    assert checked(kind, texts, Wanted((("gap",),), ClockField("t", 1.0))).all()


@pytest.mark.parametrize("kind", BOTH)
def test_floats_as_stamps_are_sure_but_for_whole_ones_that_are_too_large(kind):
    texts = [b'{"t":%r,"gap":1.5}' % (1_700_000_000 + k / 8) for k in range(100)]
    assert checked(kind, texts, Wanted((("gap",),), ClockField("t"))).mean() > 0.8


@pytest.mark.parametrize("kind", BOTH)
def test_nan_and_null_in_a_column_are_sure(kind):
    texts = [b'{"gap":%s,"v":%d.5}' % ((b"NaN", b"null", b"1.5")[k % 3], k) for k in range(300)]
    assert checked(kind, texts, Wanted((("gap",), ("v",)))).all()


@pytest.mark.parametrize("kind", BOTH)
def test_strings_of_any_language_are_passed_over(kind):
    texts = [json.dumps({"who": name, "gap": 1.5}, ensure_ascii=False).encode() for name in ("Ł", "日本", "x", "") * 20]
    assert checked(kind, texts, Wanted((("gap",),))).all()


def test_a_key_that_begins_like_a_number_that_is_none_raises_no_doubt():
    texts = [b'{"Info":%d,"NaN-NaN":{"Inf":1e3},"motor-0":0,"-0":1}' % k for k in range(100)]
    assert checked(ArrowJson, texts, Wanted((("Info",), ("NaN-NaN", "Inf")))).mean() == 0
    texts = [text.replace(b"NaN-NaN", b"NaN") for text in texts]
    assert checked(ArrowJson, texts, Wanted((("Info",), ("NaN", "Inf"), ("-0",)))).all()


def test_a_rare_broken_message_costs_only_itself():
    texts = messages(4000)
    for row in (5, 1000, 1001, 3999):
        texts[row] = texts[row].replace(b'"gap_mm": 1', b'"gap_mm": x1').replace(b'"gap_mm": 9', b'"gap_mm": x9')
    sure = checked(ArrowJson, texts, WANTED)
    assert set(np.flatnonzero(~sure)) == {5, 1000, 1001, 3999}


@pytest.mark.parametrize("kind", BOTH)
def test_a_hundred_thousand_brackets_neither_crash_nor_hang(kind):
    before = time.process_time()
    for deep in (b"[" * 100_000, b"[" * 100_000 + b"]" * 100_000, b'{"a":' * 100_000, b'"' + b'\\"[' * 30_000):
        assert not checked(kind, [b'{"gap":1,"b":' + deep + b"}"] * 20, Wanted((("gap",),))).any()
    assert time.process_time() - before < 20


def test_many_shallow_objects_are_not_deep():
    texts = [b'{"gap":%d,"list":[%s]}' % (k, b",".join([b'{"a":[1]}'] * 300)) for k in range(40)]
    assert checked(ArrowJson, texts, Wanted((("gap",), ("list", "299", "a", "0")))).all()


@pytest.mark.parametrize("kind", BOTH)
def test_payloads_outside_the_data_are_not_read(kind):
    good = payloads_of(messages(32))
    for start, length in ((-5, 10), (10**9, 10), (5, 10**12), (2**62, 2**62), (3, -1)):
        first, size = good.start.copy(), good.length.copy()
        first[7], size[7] = start, length
        assert not kind(WANTED).decode(Payloads(good.data, first, size)).sure[7]


@pytest.mark.parametrize("kind", BOTH)
def test_payloads_that_overlap_or_go_back_are_read_one_by_one(kind):
    good = payloads_of(messages(32))
    order = np.array([3, 3, 1, *range(31, 0, -1), 3])
    found = kind(WANTED).decode(Payloads(good.data, good.start[order], good.length[order]))
    assert found.sure.all()
    assert found.values[0].tolist() == order.tolist()


def test_the_whole_message_as_a_path_is_left_to_the_library():
    assert compile_json(Wanted(((),))) == ()


SCALARS = st.one_of(
    st.floats(),
    st.floats(width=32),
    st.integers(-(2**70), 2**70),
    st.integers(-5, 5),
    st.none(),
    st.booleans(),
    st.text(max_size=8),
    st.sampled_from([-0.0, 1e300, 10**400]),
)
NAMES = st.sampled_from(["a", "b", "sec", "nanosec", "secs", "nsecs", "0", "1", "é", "x y", "real"])
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=4),
    max_leaves=8,
)
ANY_PATHS = st.lists(st.lists(NAMES, min_size=1, max_size=3).map(tuple), min_size=1, max_size=4).map(tuple)
CLOCKS = st.none() | st.builds(
    ClockField,
    st.sampled_from(["a", "b", "a.b", "a.0", "b.sec"]),
    st.sampled_from([1e9, 1.0, 1e3, 0.1, 3.7]),
)


@pytest.mark.parametrize("kind", BOTH)
@given(
    contents=st.lists(st.dictionaries(NAMES, VALUES, max_size=4), min_size=1, max_size=6),
    repeat=st.integers(1, 20),
    paths=ANY_PATHS,
    clock=CLOCKS,
    gaps=st.lists(st.binary(min_size=1, max_size=40), min_size=1, max_size=3),
    ascii_only=st.booleans(),
)
@settings(deadline=None, max_examples=100)
def test_any_json_in_any_surroundings_is_read_as_the_library_reads_it_or_not_sure(
    kind, contents, repeat, paths, clock, gaps, ascii_only
):
    texts = [json.dumps(content, ensure_ascii=ascii_only).encode("utf-8", "surrogatepass") for content in contents]
    checked(kind, texts * repeat, Wanted(paths, clock), gaps)


@pytest.mark.parametrize("kind", BOTH)
@given(data=st.data())
@settings(deadline=None, max_examples=100)
def test_a_few_bytes_changed_anywhere_are_seen(kind, data):
    texts = [bytearray(text) for text in messages(24)]
    marks = st.sampled_from(list(b'"{}[],:\\0159.eE+- \n\x00\xffInfNaN'))
    for _ in range(data.draw(st.integers(1, 6))):
        text = texts[data.draw(st.integers(0, 23))]
        place = data.draw(st.integers(0, len(text) - 1))
        if data.draw(st.booleans()):
            text[place] = data.draw(marks)
        else:
            text.insert(place, data.draw(marks))
    checked(kind, [bytes(text) for text in texts], WANTED)


@given(
    shape=st.dictionaries(
        st.text(max_size=5),
        st.sampled_from(["float", "int", "text", "list"]) | st.dictionaries(st.text(max_size=3), st.just("float")),
        min_size=1,
        max_size=5,
    ),
    data=st.data(),
)
@settings(deadline=None, max_examples=100)
def test_finite_numbers_in_messages_of_one_shape_are_always_sure(shape, data):
    floats = st.floats(allow_nan=False, allow_infinity=False)

    def fill(kind):
        match kind:
            case "float":
                return data.draw(floats)
            case "int":
                return data.draw(st.integers(-(2**80), 2**80))
            case "text":
                return data.draw(st.text(st.characters(exclude_characters=',}]"\\', exclude_categories=("Cs", "Cc"))))
            case "list":
                return [data.draw(floats), data.draw(floats)]
        return {name: fill(inner) for name, inner in kind.items()}

    contents = [{name: fill(kind) for name, kind in shape.items()} for _ in range(4)]
    texts = [json.dumps(content, ensure_ascii=False).encode() for content in contents]
    paths = tuple((name,) for name, kind in shape.items() if kind in ("float", "int"))
    paths += tuple((name, "1") for name, kind in shape.items() if kind == "list")
    for kind in BOTH:
        assert checked(kind, texts * 5, Wanted(paths)).all() or not paths


def test_the_recorded_log_is_read_by_the_template(levitador):
    texts = []
    with (levitador / Path("step_json.mcap")).open("rb") as file:
        for _, _, message in make_reader(file).iter_messages():
            texts.append(message.data)
    fields = json.loads(texts[0])
    paths = tuple((name,) for name, value in fields.items() if isinstance(value, int | float))
    assert paths
    for kind in BOTH:
        assert checked(kind, texts, Wanted(paths, ClockField(paths[0][0]))).mean() > 0.95
