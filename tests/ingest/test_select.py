from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from maglev_offline.errors import InputError
from maglev_offline.ingest.select import (
    CODES,
    Selection,
    columns_needed,
    cut_segments,
    messages_mask,
    rows_mask,
    span_ns,
    wants_point,
    wants_topic,
)

T0 = 1_700_000_000_000_000_000
S = 10**9


def chosen(selection, t_s, topic="/gap", first_ns=T0):
    return messages_mask(topic, T0 + (np.array(t_s) * S).astype(np.int64), selection, first_ns)


def test_nothing_selected_is_everything_selected():
    assert Selection().selects_all
    assert chosen(Selection(), [-1, 0, 1]).keep.all()
    assert wants_topic(Selection(), "/gap")
    assert wants_point(Selection(), "F1")
    assert rows_mask({"gap_m": np.array([1.0, np.nan])}, Selection()).keep.all()


def test_the_start_belongs_to_the_selection_and_the_end_does_not():
    found = chosen(Selection(start="+1s", end="+2s"), [0, 1, 1.5, 2, 3])
    assert found.keep.tolist() == [False, True, True, False, False]
    assert found.code == "not_selected_time"
    assert found.detail.tolist() == ["before +1s", "not before +2s", "not before +2s"]


@given(st.lists(st.integers(0, 40), min_size=1, max_size=20), st.integers(1, 39))
def test_selections_that_adjoin_share_nothing_and_lose_nothing(t_s, cut):
    before, after = chosen(Selection(end=f"+{cut}s"), t_s).keep, chosen(Selection(start=f"+{cut}s"), t_s).keep
    assert (before ^ after).all()


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("2023-11-14T22:13:20Z", T0),
        ("2023-11-14T22:13:20.000000001Z", T0 + 1),
        ("2023-11-14T22:13:20,25+00:00", T0 + S // 4),
        ("2023-11-15 06:13:20.5+08:00", T0 + S // 2),
        ("+0s", T0),
        ("+12.5s", T0 + 12_500_000_000),
        ("+0.000000001s", T0 + 1),
        ("+ 250 ms", T0 + S // 4),
        ("+1.5min", T0 + 90 * S),
        ("+2h", T0 + 7200 * S),
        ("1969-12-31T23:59:59.75Z", -S // 4),
    ],
)
def test_a_time_is_read_to_the_nanosecond(text, ns):
    assert span_ns(Selection(start=text), T0)[0] == ns


def test_times_of_toml_are_taken():
    assert span_ns(Selection(start=datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC)), 0)[0] == T0


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("2023-11-14T22:13:20", "has no zone"),
        ("2023-11-14", "has no zone"),
        ("yesterday", "is no time"),
        ("12.5", "is no time"),
        ("+12.5", "is no time"),
        ("-3s", "is no time"),
        ("+1e9s", "is no time"),
        ("", "is no time"),
    ],
)
def test_what_is_no_time_is_refused(text, why):
    with pytest.raises(ValidationError, match=why):
        Selection(end=text)


def test_an_end_that_does_not_come_after_the_start_is_refused():
    for start, end in (("+2s", "+2s"), ("2023-11-14T22:13:20Z", "2023-11-14T22:13:20+01:00")):
        with pytest.raises(ValidationError, match="must be after start"):
            Selection(start=start, end=end)
    mixed = Selection(start="+10s", end="2023-11-14T22:13:25Z")
    with pytest.raises(InputError, match="in this log the end"):
        span_ns(mixed, T0)
    assert span_ns(mixed, T0 - 20 * S) == (T0 - 10 * S, T0 + 5 * S)


@pytest.mark.parametrize(
    ("topics", "exclude", "wanted"),
    [
        (["/gap"], [], ["/gap"]),
        (["/suspension/*"], [], ["/suspension/F1/state", "/suspension/F2/state"]),
        (["/suspension/F[2-9]/*", "/gap"], [], ["/suspension/F2/state", "/gap"]),
        ([], ["/suspension/*"], ["/gap", "/Gap", "/odd[1]"]),
        (["*"], ["/?ap"], ["/suspension/F1/state", "/suspension/F2/state", "/odd[1]"]),
        (["/odd[1]"], [], ["/odd[1]"]),
        (["/ga"], [], []),
    ],
)
def test_topics_are_named_or_matched(topics, exclude, wanted):
    there = ["/suspension/F1/state", "/suspension/F2/state", "/gap", "/Gap", "/odd[1]"]
    selection = Selection(topics=topics, exclude_topics=exclude)
    assert [topic for topic in there if wants_topic(selection, topic)] == wanted


def test_a_topic_that_is_not_wanted_is_left_out_for_that_reason_whatever_its_times():
    found = chosen(Selection(topics=["/other"], start="+1s"), [0, 1, 2])
    assert not found.keep.any()
    assert found.code == "not_selected_topic"


def test_points_are_named_or_matched():
    assert [p for p in ("F1", "F12", "R1") if wants_point(Selection(points=["F?"]), p)] == ["F1"]


def test_a_row_is_left_out_for_the_first_condition_that_it_fails():
    selection = Selection(where=["speed_m_s > 5", "gap_m between 0.004 and 0.012"])
    columns = {"speed_m_s": np.array([6, 4, 6, np.nan]), "gap_m": np.array([0.01, 0.02, 0.02, 0.01])}
    found = rows_mask(columns, selection)
    assert found.keep.tolist() == [True, False, False, False]
    assert found.code == "not_selected_condition"
    assert found.detail.tolist() == ["speed_m_s > 5", "gap_m between 0.004 and 0.012", "speed_m_s > 5"]
    assert columns_needed(selection) == ("speed_m_s", "gap_m")


def test_a_condition_on_a_column_that_is_not_there_lists_the_columns():
    with pytest.raises(InputError, match=r"no column speed_m_s; there are contact, gap_m\."):
        rows_mask({"gap_m": np.zeros(2), "contact": np.zeros(2, dtype=bool)}, Selection(where=["speed_m_s > 5"]))


def test_no_rows_are_no_problem():
    found = rows_mask({"gap_m": np.empty(0)}, Selection(where=["gap_m > 1", "1 > 2"]))
    assert len(found.keep) == len(found.detail) == 0


def test_a_condition_that_cannot_be_is_told_of_when_the_recipe_is_read():
    with pytest.raises(ValidationError, match="is not allowed"):
        Selection(where=["gap_m > 1", "open('x') > 1"])


def test_every_code_is_told_apart():
    assert len(set(CODES)) == 4


def test_a_row_that_is_cut_out_ends_a_segment():
    segment = np.array([0, 0, 0, 0, 1, 1, 2, 2], dtype=np.int32)
    step = np.array([0, 1, 2, 3, 0, 1, 0, 1], dtype=np.int32)
    keep = np.array([1, 0, 1, 1, 0, 0, 1, 1], dtype=bool)
    number, place = cut_segments(segment, step, keep)
    assert number.tolist() == [0, 1, 1, 2, 2]
    assert place.tolist() == [0, 0, 1, 0, 1]
    assert number.dtype == place.dtype == np.int32
    assert len(cut_segments(segment, step, np.zeros(8, dtype=bool))[0]) == 0


@given(st.lists(st.integers(1, 5), max_size=6), st.randoms(use_true_random=False))
def test_rows_are_neighbours_after_the_cut_only_if_they_were_before(lengths, random):
    segment = np.repeat(np.arange(len(lengths)), lengths).astype(np.int32)
    step = np.concatenate([np.arange(n) for n in lengths] or [[]]).astype(np.int32)
    keep = np.array([random.random() < 0.7 for _ in segment], dtype=bool)
    number, place = cut_segments(segment, step, keep)
    rows = np.flatnonzero(keep)
    for k in range(1, len(rows)):
        neighbours = segment[rows[k]] == segment[rows[k - 1]] and rows[k] == rows[k - 1] + 1
        assert (number[k] == number[k - 1]) == neighbours
        assert place[k] == (place[k - 1] + 1 if neighbours else 0)
    assert set(number) == set(range(len(set(number))))
