import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.ingest.contact import split, touched_rows


def mask(text):
    return np.array([c == "x" for c in text])


@pytest.mark.parametrize(
    ("touching", "kept", "segments"),
    [
        ("....", "xxxx", [0, 0, 0, 0]),
        ("..xxx..", "xxx..xx", [0, 0, 0, 1, 1]),  # the first row of the run ends its segment
        ("..x..", "xxxxx", [0, 0, 0, 1, 1]),
        ("xx..", "..xx", [0, 0]),  # nothing ran into this contact
        ("..xx", "xxx.", [0, 0, 0]),
        ("xxxx", "....", []),
    ],
)
def test_a_contact_ends_its_segment(touching, kept, segments):
    keep, segment = split(mask(touching), np.zeros(len(touching), np.int64))
    assert keep.tolist() == mask(kept).tolist()
    _, renumbered = np.unique(segment[keep], return_inverse=True)
    assert renumbered.tolist() == segments


def test_a_run_across_a_hole_is_two_runs():
    keep, _ = split(mask(".xx.."), np.array([0, 0, 1, 1, 1]))
    assert keep.tolist() == [True, True, False, True, True]


@given(st.lists(st.tuples(st.booleans(), st.booleans()), max_size=60))
def test_contact_rows_that_stay_are_the_last_of_their_segment(rows):
    touching = np.array([touch for touch, _ in rows], dtype=bool)
    before = np.cumsum([new for _, new in rows]).astype(np.int64)
    keep, segment = split(touching, before)
    kept, number = touching[keep], segment[keep]
    ends = np.append(number[1:] != number[:-1], True) if len(number) else np.empty(0, bool)
    assert (ends[kept]).all()
    assert (~touching <= keep).all()


def test_a_bounce_between_two_instants_counts_for_the_later_one():
    # Messages at 0, 50, 150 and 199, rows at 0, 100 and 200.
    rows = touched_rows(np.zeros(3, bool), mask("..x."), through=np.array([1, 2, 4]), begins=np.array([0]))
    assert rows.tolist() == [False, False, True]


def test_a_bounce_between_two_stretches_counts_for_none():
    rows = touched_rows(mask("...x"), mask("..x.."), through=np.array([1, 2, 4, 5]), begins=np.array([0, 2]))
    assert rows.tolist() == [False, False, False, True]


def test_a_message_on_the_instant_is_that_row_and_not_the_next():
    rows = touched_rows(mask(".x."), mask(".x."), through=np.array([1, 2, 3]), begins=np.array([0]))
    assert rows.tolist() == [False, True, False]
