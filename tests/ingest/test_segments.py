from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.ingest.segments import eras_of, in_common, lone, stretch_of, stretches


def stretches_of(times, bridge=25, epoch=None, file_index=None):
    t = np.array(times, dtype=np.int64)
    epoch = np.zeros(len(t), np.int32) if epoch is None else np.array(epoch, np.int32)
    file_index = np.arange(len(t)) if file_index is None else np.array(file_index)
    return stretches(t, stretch_of(t, epoch, bridge), epoch, file_index)


def test_a_longer_silence_than_the_bridge_is_a_hole():
    assert stretch_of(np.array([0, 10, 35, 61]), np.zeros(4, np.int32), 25).tolist() == [0, 0, 0, 1]


def test_a_new_epoch_begins_a_stretch():
    assert stretch_of(np.array([0, 10, 10, 20]), np.array([0, 0, 1, 1], np.int32), 25).tolist() == [0, 0, 1, 1]


def test_lone_messages():
    assert lone(np.array([0, 1, 1, 2])).tolist() == [True, False, False, True]
    assert lone(np.empty(0, np.int64)).tolist() == []


def test_the_ends_of_a_stretch_are_its_messages():
    found = stretches_of([0, 10, 20, 100, 110])
    assert found.start_ns.tolist() == [0, 100]
    assert found.end_ns.tolist() == [20, 110]
    assert found.stop.tolist() == [3, 5]


def test_topics_have_their_overlaps_in_common():
    common = in_common([stretches_of([0, 20, 40, 100, 120]), stretches_of([15, 35, 55, 75, 95, 115, 135])])
    assert common.start_ns.tolist() == [15, 100]
    assert common.end_ns.tolist() == [40, 120]
    assert common.parts.tolist() == [[0, 0], [1, 0]]


def test_three_topics():
    common = in_common([stretches_of(range(a, 200, 20)) for a in (0, 5, 10)])
    assert (common.start_ns.tolist(), common.end_ns.tolist()) == ([10], [180])


def test_nothing_in_common():
    assert len(in_common([stretches_of([0, 10]), stretches_of([50, 60])]).start_ns) == 0
    assert len(in_common([stretches_of([]), stretches_of([50, 60])]).start_ns) == 0


def test_the_same_times_from_before_and_after_a_reset_do_not_meet():
    # Two topics in turn; the clock was set back to 0 after six messages of the file.
    a = stretches_of([0, 10, 20, 0, 10, 20], epoch=[0, 0, 0, 1, 1, 1], file_index=[0, 2, 4, 6, 8, 10])
    b = stretches_of([0, 10, 20, 0, 10, 20], epoch=[0, 0, 0, 1, 1, 1], file_index=[1, 3, 5, 7, 9, 11])
    assert in_common([a, b]).parts.tolist() == [[0, 0], [1, 1]]


def test_a_topic_that_was_not_reset_meets_every_epoch_of_the_other():
    a = stretches_of([0, 10, 20, 5, 15, 25], epoch=[0, 0, 0, 1, 1, 1])
    b = stretches_of([0, 10, 20, 30], file_index=[100, 101, 102, 103])
    assert in_common([a, b]).parts.tolist() == [[0, 0], [1, 0]]


def test_topics_that_were_reset_differently_meet_where_the_file_has_them_together():
    a = stretches_of([0, 10, 0, 10, 0, 10], epoch=[0, 0, 1, 1, 2, 2], file_index=[0, 2, 4, 5, 6, 8])
    b = stretches_of([0, 10, 0, 10], epoch=[0, 0, 1, 1], file_index=[1, 3, 7, 9])
    assert in_common([a, b]).parts.tolist() == [[0, 0], [2, 1]]


def test_topics_written_one_after_the_other_meet_as_well():
    a = stretches_of([0, 10, 0, 10], epoch=[0, 0, 1, 1], file_index=[0, 1, 2, 3])
    b = stretches_of([0, 10, 0, 10], epoch=[0, 0, 1, 1], file_index=[4, 5, 6, 7])
    assert in_common([a, b]).parts.tolist() == [[0, 0], [1, 1]]


def test_a_step_over_all_of_time_is_a_hole():
    ends = np.array([-(2**62) - 2**61, 2**62 + 2**61])
    assert stretch_of(ends, np.zeros(2, np.int32), 25).tolist() == [0, 1]


some_epochs = st.lists(st.lists(st.integers(1, 60), min_size=1, max_size=12), min_size=1, max_size=3)


@given(st.lists(some_epochs, min_size=2, max_size=3), st.booleans())
def test_stretches_meet_where_times_and_eras_do_and_nowhere_else(topics, in_turn):
    made = []
    for k, epochs in enumerate(topics):
        t = np.concatenate([np.cumsum(steps) for steps in epochs])
        epoch = np.repeat(np.arange(len(epochs)), [len(steps) for steps in epochs])
        made.append(stretches_of(t, epoch=epoch, file_index=np.arange(len(t)) * 3 + k + (0 if in_turn else 1000 * k)))
    common = in_common(made)
    spans = [
        list(zip(s.start_ns, s.end_ns, *era, range(len(s)), strict=True))
        for s, era in zip(made, eras_of(made), strict=True)
    ]
    expected = []
    for parts in product(*spans):
        start, end = max(p[0] for p in parts), min(p[1] for p in parts)
        first, last = max(p[2] for p in parts), min(p[3] for p in parts)
        if start <= end and first <= last:
            expected.append((start, end, first, last, *(p[4] for p in parts)))
    found = np.column_stack([common.start_ns, common.end_ns, common.era_first, common.era_last, common.parts])
    assert [tuple(row) for row in found.tolist()] == expected


@given(st.lists(st.lists(st.integers(1, 60), min_size=1, max_size=12), max_size=5), st.randoms(use_true_random=False))
def test_an_epoch_spans_its_messages_in_the_file(epochs, random):
    t = [time for steps in epochs for time in np.cumsum(steps)]
    epoch = np.repeat(np.arange(len(epochs)), [len(steps) for steps in epochs])
    places = list(range(len(t)))
    random.shuffle(places)
    found = stretches_of(t, epoch=epoch, file_index=places)
    for k in range(len(found)):
        of_epoch = np.array(places)[epoch == found.epoch[k]]
        assert (found.file_first[k], found.file_last[k]) == (of_epoch.min(), of_epoch.max())
        assert (np.diff(t[found.first[k] : found.stop[k]]) <= 25).all()
