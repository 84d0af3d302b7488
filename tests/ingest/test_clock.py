import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.ingest.clock import choose, epochs, steps_of, time_order
from maglev_offline.logs.reader import ChannelColumns


def test_the_chosen_clock():
    n = np.arange(3)
    columns = ChannelColumns("/a", n, n + 10, n, n, {}, n >= 0, n + 20)
    assert choose(columns, "log_time")[0] == 0
    assert choose(columns, "publish_time")[0] == 10
    assert choose(columns, "header")[0] == 20


def test_a_publish_time_that_the_sender_left_at_zero_gives_way_to_the_log_time():
    n = np.arange(1, 4)
    columns = ChannelColumns("/a", n, np.array([0, 12, 0]), n, n, {}, n >= 0, None)
    assert choose(columns, "publish_time").tolist() == [1, 12, 3]


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ([0, 10, 20], [0, 0, 0]),
        ([0, 20, 10, 30], [0, 0, 0, 0]),  # late by 10: sorted in
        ([100, 200, 0, 10], [0, 0, 1, 1]),  # back by 200: a reset
        ([100, 50, 0], [0, 0, 1]),  # the last one is late by 100, if little by little
        ([500, 0, 500, 0], [0, 1, 1, 2]),
        ([], []),
        ([7], [0]),
    ],
)
def test_a_jump_back_beyond_the_reorder_window_is_a_reset(times, expected):
    assert epochs(np.array(times, dtype=np.int64), 50).tolist() == expected


@given(st.lists(st.integers(0, 10_000), max_size=900), st.integers(0, 3000))
def test_epochs_follow_their_definition(times, reorder):
    expected, epoch, latest = [], 0, None
    for t in times:
        if latest is not None and t < latest - reorder:
            epoch, latest = epoch + 1, t
        latest = t if latest is None else max(latest, t)
        expected.append(epoch)
    assert epochs(np.array(times, dtype=np.int64), reorder).tolist() == expected


def test_messages_of_one_time_stay_in_file_order():
    order = time_order(np.array([20, 10, 10, 5]), np.array([0, 0, 0, 1], dtype=np.int32))
    assert order.tolist() == [1, 2, 0, 3]


def test_steps():
    assert steps_of(np.array([0, 10, 22, 30])) == (10.0, pytest.approx(np.std([10, 12, 8])), 12.0)
    assert steps_of(np.array([3])) == (None, None, None)


def test_a_hole_is_no_jitter_but_the_greatest_step():
    assert steps_of(np.array([0, 10, 20, 60])) == (10.0, 0.0, 40.0)
    assert steps_of(np.array([0, 10, 20, 31, 31 + 10**9])) == (10.5, pytest.approx(np.std([10, 10, 11])), 1e9)
