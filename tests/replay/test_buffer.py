import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.errors import InputError
from maglev_offline.replay.buffer import WIDTH, ReplayBuffer, pack

JUST_BELOW_1 = np.nextafter(1.0, 0.0)


def rows_of(n, first=0):
    """Rows that carry their number in the cost column."""
    rows = np.zeros((n, WIDTH), dtype=np.float32)
    rows[:, 4] = np.arange(first, first + n)
    return rows


def everything_in(buffer):
    """The cost column of all slots that can be sampled, one draw in the middle of each."""
    n = len(buffer)
    seeds = len(buffer.rows)
    batch = buffer.sample(np.tile((np.arange(n) + 0.5) / n, (seeds, 1)))
    return batch.cost[..., 0].numpy()


def test_packed_columns_come_back_as_they_were():
    rng = np.random.default_rng(0)
    columns = [rng.uniform(-1, 1, (6, 3)), rng.uniform(-1, 1, 6), rng.uniform(0, 9, 6),
               rng.uniform(-1, 1, (6, 3)), np.full(6, 0.9)]  # fmt: skip
    rows = pack(*columns)
    assert rows.shape == (6, WIDTH)
    buffer = ReplayBuffer(1, 10)
    buffer.prefill(rows)
    batch = buffer.sample((np.arange(6) + 0.5)[None] / 6)
    for found, column in zip(batch, columns, strict=True):
        np.testing.assert_array_equal(found[0].numpy(), column.astype(np.float32).reshape(6, -1))


@settings(deadline=None)
@given(st.integers(1, 4), st.integers(0, 20), st.integers(0, 60), st.integers(1, 15))
def test_prefilled_rows_stay_in_order_and_once_however_often_the_ring_wraps(seeds, prefilled, added, room):
    buffer = ReplayBuffer(seeds, prefilled + room)
    buffer.prefill(rows_of(prefilled))
    for number in range(added):
        buffer.add(np.repeat(rows_of(1, first=1000 + number), seeds, axis=0))
    assert len(buffer) == prefilled + min(added, room)
    if not len(buffer):
        return
    newest = range(1000 + max(0, added - room), 1000 + added)
    for seed in everything_in(buffer):
        assert seed[:prefilled].tolist() == list(range(prefilled))
        assert sorted(seed[prefilled:]) == list(newest)


def test_each_seed_gets_its_own_new_rows():
    buffer = ReplayBuffer(3, 5)
    buffer.prefill(rows_of(2))
    buffer.add(rows_of(3, first=7))
    assert everything_in(buffer).tolist() == [[0, 1, 7], [0, 1, 8], [0, 1, 9]]


@settings(deadline=None)
@given(st.integers(1, 2000))
def test_draws_from_0_to_just_below_1_reach_the_first_and_the_last_slot(filled):
    buffer = ReplayBuffer(1, filled + 7)
    buffer.prefill(rows_of(filled))
    assert buffer.sample(np.array([[0.0, JUST_BELOW_1]])).cost[0, :, 0].tolist() == [0, filled - 1]


def test_sampling_covers_the_filled_slots_evenly_and_no_other():
    buffer = ReplayBuffer(2, 1000)
    buffer.prefill(rows_of(10, first=1))
    cost = buffer.sample(np.random.default_rng(0).random((2, 20_000))).cost[..., 0].numpy().astype(int)
    for seed in cost:
        counts = np.bincount(seed, minlength=12)
        assert counts[0] == counts[11] == 0
        np.testing.assert_allclose(counts[1:11] / 20_000, 0.1, atol=0.01)


def test_a_batch_has_a_seed_axis_and_columns():
    buffer = ReplayBuffer(2, 4)
    buffer.prefill(rows_of(3))
    batch = buffer.sample(np.zeros((2, 5)))
    assert [tuple(part.shape) for part in batch] == [(2, 5, 3), (2, 5, 1), (2, 5, 1), (2, 5, 3), (2, 5, 1)]


def test_an_empty_buffer_has_nothing_to_sample():
    with pytest.raises(InputError, match="empty"):
        ReplayBuffer(1, 4).sample(np.zeros((1, 2)))


@pytest.mark.parametrize("n", [4, 5])
def test_a_prefill_that_leaves_no_slot_is_refused(n):
    with pytest.raises(InputError, match=rf"{n} prefilled rows do not fit into 4 slots.*buffer_capacity"):
        ReplayBuffer(1, 4).prefill(rows_of(n))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", range(WIDTH))
def test_a_row_that_is_not_finite_is_refused_and_named(column, value):
    rows = rows_of(5)
    rows[3, column] = value
    buffer = ReplayBuffer(1, 10)
    with pytest.raises(InputError, match="1 prefilled rows are not finite, first row 3"):
        buffer.prefill(rows)
    assert len(buffer) == 0


@pytest.mark.parametrize("action", [1.0001, -1.5])
def test_an_action_outside_its_range_is_refused_and_named(action):
    rows = rows_of(5)
    rows[2:4, 3] = action
    with pytest.raises(InputError, match=r"2 prefilled actions lie outside \[-1, 1\], first row 2"):
        ReplayBuffer(1, 10).prefill(rows)


def test_actions_at_the_ends_of_the_range_are_taken():
    rows = rows_of(2)
    rows[:, 3] = [-1, 1]
    buffer = ReplayBuffer(1, 10)
    buffer.prefill(rows)
    assert len(buffer) == 2


def test_a_buffer_that_holds_rows_is_not_prefilled():
    once, twice = ReplayBuffer(1, 10), ReplayBuffer(1, 10)
    once.add(rows_of(1))
    twice.prefill(rows_of(1))
    for buffer in (once, twice):
        with pytest.raises(InputError, match="already holds rows"):
            buffer.prefill(rows_of(1))


@pytest.mark.parametrize("shape", [(3, WIDTH + 1), (3, WIDTH - 1), (WIDTH,), (1, 3, WIDTH)])
def test_rows_of_another_width_are_refused(shape):
    with pytest.raises(InputError, match="expected"):
        ReplayBuffer(1, 10).prefill(np.zeros(shape, dtype=np.float32))
