import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.errors import InputError
from maglev_offline.ingest.conditions import DEEPEST, LONGEST, parse

NAN = np.nan
COLUMNS = {"speed_m_s": np.array([0.0, 5.0, 6.0, NAN]), "gap_m": np.array([0.003, 0.004, 0.012, 0.013])}


def holds(text, columns=COLUMNS, rows=4):
    return parse(text).holds(columns, rows).tolist()


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("speed_m_s > 5", [0, 0, 1, 0]),
        ("speed_m_s >= 5", [0, 1, 1, 0]),
        ("speed_m_s == 5", [0, 1, 0, 0]),
        ("speed_m_s != 5", [1, 0, 1, 0]),
        ("gap_m between 0.004 and 0.012", [0, 1, 1, 0]),
        ("gap_m between 4e-3 and +.012 and speed_m_s > 5", [0, 0, 1, 0]),
        ("speed_m_s < 1 or gap_m between 0.013 and 1", [1, 0, 0, 1]),
        ("0.004 <= gap_m < 0.012", [0, 1, 0, 0]),
        ("not gap_m > 0.004", [1, 1, 0, 0]),
        ("not (gap_m > 0.003 and gap_m < 0.013)", [1, 0, 0, 1]),
        ("(gap_m - 0.003) * 1000 >= 9.5", [0, 0, 0, 1]),
        ("-gap_m / 2 + 1 > 0.995", [1, 1, 0, 0]),
        ("1 < 2", [1, 1, 1, 1]),
        ("2 < 1", [0, 0, 0, 0]),
    ],
)
def test_a_condition_holds_for_the_rows_that_it_says(text, rows):
    assert holds(text) == [bool(row) for row in rows]


@pytest.mark.parametrize("text", ["speed_m_s > 5", "speed_m_s != 5", "0 <= speed_m_s", "speed_m_s / gap_m > 1"])
def test_a_row_whose_value_is_not_known_fulfils_neither_a_condition_nor_its_opposite(text):
    assert not holds(text)[3]
    assert not holds(f"not {text}")[3]
    assert not holds(f"not not ({text})")[3]


def test_what_is_known_decides_where_it_can():
    assert holds("speed_m_s > 5 or gap_m > 0.012")[3]
    assert holds("not (speed_m_s > 5 and gap_m < 0.012)")[3]


def test_a_division_by_zero_is_not_known():
    columns = {"a": np.array([1.0, 0.0])}
    assert holds("1 / a > 0", columns, 2) == [True, False]
    assert holds("not 1 / a > 0", columns, 2) == [False, False]


values = st.lists(st.one_of(st.floats(-2, 2), st.just(NAN)), min_size=3, max_size=3)


comparisons = st.sampled_from(["<", "<=", ">", ">=", "==", "!="])


@given(values, values, comparisons, comparisons)
def test_not_follows_de_morgan(a, b, first, second):
    columns = {"a": np.array(a), "b": np.array(b)}
    left, right = f"a {first} b", f"b {second} 0.5"
    assert holds(f"not ({left} and {right})", columns, 3) == holds(f"not {left} or not {right}", columns, 3)
    assert holds(f"not ({left} or {right})", columns, 3) == holds(f"not {left} and not {right}", columns, 3)


def test_the_columns_are_named_in_their_order():
    assert parse("gap_m > 1 and (speed_m_s < 2 or gap_m < 3)").columns == ("gap_m", "speed_m_s")


def test_a_column_that_is_not_there_is_named_with_those_that_are():
    with pytest.raises(InputError, match=r"no column sped_m_s; there are gap_m, speed_m_s\."):
        holds("sped_m_s > 5")


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "gap_m.real > 1",
        "gap_m[0] > 1",
        "(lambda: 1)() > 1",
        "[x for x in gap_m]",
        "gap_m in (1, 2)",
        "gap_m is 1",
        "gap_m ** 9 > 1",
        "gap_m % 2 > 1",
        "~gap_m > 1",
        "gap_m > 'a'",
        "gap_m > 1j",
        "gap_m > None",
        "gap_m > True",
        "True",
        "gap_m > 1e999",
        f"gap_m > 1{'0' * 400}",
        "(x := 5) > 1",
        "1 if gap_m > 1 else 2",
        "gap_m > (speed_m_s > 1)",
        "f'{gap_m}' > 1",
        "await x",
    ],
)
def test_anything_else_is_refused(text):
    with pytest.raises(ValueError, match=r"not allowed|no comparison|no condition|too large"):
        parse(text)


@pytest.mark.parametrize("text", ["", "   ", "gap_m >", "gap_m > 1)", "gap_m > 1; x", "gap_m = 1", "a between 1", "\0"])
def test_what_is_no_expression_is_refused(text):
    with pytest.raises(ValueError, match="no condition"):
        parse(text)


@pytest.mark.parametrize("text", ["gap_m", "gap_m + 1", "-gap_m", "5", "not gap_m", "gap_m and speed_m_s > 1"])
def test_a_number_is_no_condition(text):
    with pytest.raises(ValueError, match="is no comparison"):
        parse(text)


def test_a_condition_cannot_be_without_end():
    with pytest.raises(ValueError, match=f"at most {LONGEST} characters"):
        parse("a > 1" + " or a > 1" * LONGEST)
    for text in ("-" * 1500 + "1 > a", "(" * 900 + "1 > a" + ")" * 900, "not " * 400 + "1 > a"):
        with pytest.raises(ValueError, match=rf"more than {DEEPEST} levels|no condition"):
            parse(text)


@given(st.text(max_size=40))
def test_any_text_is_a_condition_or_a_value_error(text):
    with contextlib.suppress(ValueError):
        parse(text).holds(dict.fromkeys(parse(text).columns, np.zeros(2)), 2)
