"""Rows that fail a condition go into the ledger, and segments end where they were."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.errors import InputError
from maglev_offline.ingest.chosen_rows import choose_rows
from maglev_offline.ingest.points import LONE_SAMPLE, PointSamples
from maglev_offline.ingest.select import NOT_SELECTED_CONDITION, Selection

TOPIC = "/suspension/F1/state"
STEP_NS = 100_000_000


def rows(gap_m, segment=None, *, contact=None, entries=()):
    """Rows of a point, each 100 ms after the one before; a new segment comes a second later."""
    n = len(gap_m)
    segment = np.zeros(n, dtype=np.int32) if segment is None else np.asarray(segment, dtype=np.int32)
    first = np.searchsorted(segment, segment)
    return PointSamples(
        point="F1",
        t_ns=np.arange(n) * STEP_NS + segment.astype(np.int64) * 10**9,
        segment=segment,
        step=(np.arange(n) - first).astype(np.int32),
        values={"gap_m": np.asarray(gap_m, dtype=np.float64), "current_a": np.arange(n, dtype=np.float64)},
        origins={"gap_m": np.zeros(n, dtype=np.int8)},
        contact=np.zeros(n, dtype=np.bool_) if contact is None else np.asarray(contact),
        grid_rows=n + sum(entry.total for entry in entries),
        entries=list(entries),
        within={},
        used={},
    )


def put_aside(samples, code):
    return np.concatenate([[], *(entry.t_ns for entry in samples.entries if entry.code == code)]).astype(int).tolist()


def test_without_a_condition_nothing_is_touched():
    samples = rows([0.008] * 5)
    assert choose_rows(samples, TOPIC, Selection(points=("F1",))) is samples


def test_rows_that_fail_are_put_aside_with_the_condition_that_they_fail():
    samples = rows([1, 2, 3, 4, 5, 6])
    chosen = choose_rows(samples, TOPIC, Selection(where=("gap_m > 2", "current_a < 4")))
    assert chosen.values["gap_m"].tolist() == [3, 4]
    assert chosen.t_ns.tolist() == [2 * STEP_NS, 3 * STEP_NS]
    (entry,) = [entry for entry in chosen.entries if entry.code == NOT_SELECTED_CONDITION]
    assert (entry.level, entry.point, entry.topic) == ("sample", "F1", TOPIC)
    assert entry.t_ns.tolist() == [k * STEP_NS for k in (0, 1, 4, 5)]
    assert list(entry.detail) == ["gap_m > 2", "gap_m > 2", "current_a < 4", "current_a < 4"]


def test_a_segment_ends_where_a_row_goes():
    chosen = choose_rows(rows([1, 1, 0, 1, 1, 1]), TOPIC, Selection(where=("gap_m == 1",)))
    assert chosen.segment.tolist() == [0, 0, 1, 1, 1]
    assert chosen.step.tolist() == [0, 1, 0, 1, 2]


def test_a_row_that_is_left_alone_goes_too():
    chosen = choose_rows(rows([1, 0, 1, 1, 0, 1]), TOPIC, Selection(where=("gap_m == 1",)))
    assert chosen.t_ns.tolist() == [2 * STEP_NS, 3 * STEP_NS]
    assert put_aside(chosen, LONE_SAMPLE) == [0, 5 * STEP_NS]
    assert (chosen.segment.tolist(), chosen.step.tolist()) == ([0, 0], [0, 1])


def test_nothing_may_be_left():
    chosen = choose_rows(rows([1, 2, 3]), TOPIC, Selection(where=("gap_m > 9",)))
    assert len(chosen.t_ns) == len(chosen.segment) == len(chosen.contact) == 0
    assert put_aside(chosen, NOT_SELECTED_CONDITION) == [0, STEP_NS, 2 * STEP_NS]


def test_a_row_of_which_a_value_is_not_known_is_not_chosen():
    chosen = choose_rows(rows([1, 1, np.nan, 1, 1]), TOPIC, Selection(where=("not gap_m > 2",)))
    assert put_aside(chosen, NOT_SELECTED_CONDITION) == [2 * STEP_NS]


def test_contact_is_a_column_too():
    samples = rows([1, 1, 1, 1], contact=[True, False, False, False])
    assert choose_rows(samples, TOPIC, Selection(where=("contact == 0",))).t_ns.tolist() == [
        k * STEP_NS for k in (1, 2, 3)
    ]


def test_a_column_that_is_not_there_is_refused_in_words():
    with pytest.raises(InputError, match="there is no column speed_m_s; there are contact, current_a, gap_m"):
        choose_rows(rows([1, 2]), TOPIC, Selection(where=("speed_m_s > 5",)))


@given(
    st.lists(st.tuples(st.booleans(), st.integers(0, 1)), max_size=40),
    st.lists(st.booleans(), min_size=40, max_size=40),
)
def test_every_row_is_kept_or_put_aside_and_what_followed_each_other_still_does(made, touching):
    segment = np.cumsum([new for _, new in made]).astype(np.int32) if made else []
    samples = rows([1.0 * good for good, _ in made], segment, contact=np.array(touching[: len(made)], dtype=np.bool_))
    chosen = choose_rows(samples, TOPIC, Selection(where=("gap_m == 1",)))
    aside = put_aside(chosen, NOT_SELECTED_CONDITION) + put_aside(chosen, LONE_SAMPLE)
    assert sorted([*chosen.t_ns.tolist(), *aside]) == samples.t_ns.tolist()
    assert chosen.grid_rows == len(chosen.t_ns) + sum(entry.total for entry in chosen.entries)
    assert (chosen.values["gap_m"] == 1).all()
    assert {len(column) for column in (*chosen.values.values(), *chosen.origins.values(), chosen.contact)} == {
        len(chosen.t_ns)
    }
    for k in range(1, len(chosen.t_ns)):
        follows = chosen.t_ns[k] - chosen.t_ns[k - 1] == STEP_NS
        joined = chosen.segment[k] == chosen.segment[k - 1]
        assert joined == follows
        assert chosen.step[k] == (chosen.step[k - 1] + 1 if joined else 0)
    assert 1 not in np.bincount(chosen.segment)  # none is alone
