import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.errors import InputError
from maglev_offline.replay.buffer import WIDTH, ReplayBuffer, pack
from maglev_offline.replay.sampling import Mixture

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
    rows = pack(*columns, np.ones(6, dtype=bool))
    assert rows.shape == (6, WIDTH)
    buffer = ReplayBuffer(1, 10)
    buffer.prefill(rows)
    batch = buffer.sample((np.arange(6) + 0.5)[None] / 6)
    for found, column in zip(batch[:5], columns, strict=True):
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
    assert [tuple(part.shape) for part in batch[:5]] == [(2, 5, 3), (2, 5, 1), (2, 5, 1), (2, 5, 3), (2, 5, 1)]


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
    with pytest.raises(InputError, match=r"row 3, column prefill: the value is not finite \(1 such rows\)"):
        buffer.prefill(rows)
    assert len(buffer) == 0


@pytest.mark.parametrize("action", [1.0001, -1.5])
def test_an_action_outside_its_range_is_refused_and_named(action):
    rows = rows_of(5)
    rows[2:4, 3] = action
    with pytest.raises(InputError, match=r"row 2, column action: .* lies outside \[-1, 1\] \(2 such rows\)"):
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


def episode(costs, *, discount=0.9, ends=(), cuts=()):
    """Rows of one seed, one for each cost: observation k leads to observation k + 1."""
    n = len(costs)
    rows = np.zeros((n, WIDTH), dtype=np.float32)
    rows[:, 0], rows[:, 4], rows[:, 5] = np.arange(n), costs, np.arange(1, n + 1)
    rows[:, 8] = [0.0 if k in ends else discount for k in range(n)]
    rows[:, 9] = [k in ends or k in cuts for k in range(n)]
    return rows


def n_step_batch(rows, n, *, capacity=100, prefill=None):
    """All filled slots of a buffer that sums n rows: cost, last next observation, discount."""
    buffer = ReplayBuffer(1, capacity, n_step=n)
    if prefill is not None:
        buffer.prefill(prefill)
    for row in rows:
        buffer.add(row[None])
    size = len(buffer)
    batch = buffer.sample((np.arange(size) + 0.5)[None] / size)
    return [field[0, :, 0].numpy() for field in (batch.cost, batch.next_observation, batch.discount)]


def test_the_costs_of_n_rows_are_summed_each_with_the_discounts_before_it():
    cost, following, discount = n_step_batch(episode([1, 2, 4, 8, 16]), 3)
    np.testing.assert_allclose(cost[0], 1 + 0.9 * 2 + 0.81 * 4, rtol=1e-6)
    assert following[0] == 3
    np.testing.assert_allclose(discount[0], 0.9**3, rtol=1e-6)


def test_the_newest_rows_sum_what_there_is():
    cost, following, discount = n_step_batch(episode([1, 2, 4]), 3)
    np.testing.assert_allclose(cost, [1 + 0.9 * 2 + 0.81 * 4, 2 + 0.9 * 4, 4], rtol=1e-6)
    assert following.tolist() == [3, 3, 3]
    np.testing.assert_allclose(discount, [0.9**3, 0.9**2, 0.9], rtol=1e-6)


@pytest.mark.parametrize("kind", ["cuts", "ends"])
def test_no_sum_runs_across_the_end_of_an_episode(kind):
    cost, following, discount = n_step_batch(episode([1, 2, 4, 8, 16], **{kind: {1}}), 4)
    np.testing.assert_allclose(cost[:2], [1 + 0.9 * 2, 2], rtol=1e-6)
    assert following[:2].tolist() == [2, 2]
    np.testing.assert_allclose(discount[:2], [0.81, 0.9] if kind == "cuts" else [0, 0], rtol=1e-6)
    np.testing.assert_allclose(cost[2], 4 + 0.9 * 8 + 0.81 * 16, rtol=1e-6)


def test_a_sum_goes_on_where_the_ring_wraps_and_stops_at_its_newest_row():
    cost, following, _ = n_step_batch(episode([1, 2, 4, 8, 16, 32]), 3, capacity=4)
    # slots hold the rows 4, 5, 2, 3
    np.testing.assert_allclose(cost, [16 + 0.9 * 32, 32, 4 + 0.9 * 8 + 0.81 * 16, 8 + 0.9 * 16 + 0.81 * 32], rtol=1e-6)
    assert following.tolist() == [6, 6, 5, 6]


def test_prefilled_rows_stay_one_step_rows():
    prefill = episode([100, 200, 300], cuts={0, 1, 2})
    cost, _, discount = n_step_batch(episode([1, 2]), 3, prefill=prefill)
    np.testing.assert_allclose(cost, [100, 200, 300, 1 + 0.9 * 2, 2], rtol=1e-6)
    np.testing.assert_allclose(discount[:3], 0.9, rtol=1e-6)


@settings(deadline=None, max_examples=50)
@given(
    st.lists(st.tuples(st.floats(0, 9), st.sampled_from([0.0, 0.9]), st.booleans()), min_size=1, max_size=30),
    st.integers(1, 6),
    st.integers(2, 12),
    st.integers(0, 3),
)
def test_sums_are_those_of_a_loop_over_time(steps, n, room, prefilled):
    rows = episode([cost for cost, _, _ in steps])
    rows[:, 8] = [d for _, d, _ in steps]
    rows[:, 9] = [cut or d == 0 for _, d, cut in steps]
    found = n_step_batch(rows, n, capacity=room + prefilled, prefill=np.ones((prefilled, WIDTH), dtype=np.float32))
    kept = {k % room: k for k in range(len(rows))}
    for slot, first in kept.items():
        cost, discount, k = np.float64(rows[first, 4]), np.float64(rows[first, 8]), first
        while k - first + 1 < n and not rows[k, 9] and k + 1 < len(rows):
            k += 1
            cost, discount = cost + discount * rows[k, 4], discount * rows[k, 8]
        values = [column[prefilled + slot] for column in found]
        np.testing.assert_allclose(values, [cost, rows[k, 5], discount], rtol=1e-5)


def test_a_batch_says_which_of_its_rows_were_prefilled():
    buffer = ReplayBuffer(2, 10)
    buffer.add(rows_of(2))
    assert buffer.sample(np.zeros((2, 3))).prefilled is None
    buffer = ReplayBuffer(2, 10)
    buffer.prefill(rows_of(2))
    buffer.add(rows_of(2))
    batch = buffer.sample(np.array([[0.1, 0.5, 0.9], [0.9, 0.9, 0.1]]))
    assert batch.prefilled[..., 0].tolist() == [[1, 1, 0], [0, 0, 1]]


def test_the_mixture_is_taken_at_the_step_that_is_given():
    buffer = ReplayBuffer(1, 10, mixture=Mixture(0.5, 100))
    buffer.prefill(rows_of(2))
    buffer.add(rows_of(1))
    shares = [buffer.sample(np.full((1, 10), 0.5), step).prefilled.sum() for step in (0, 40, 200)]
    assert shares == [5, 3, 0]


@pytest.mark.parametrize("added", [0, 3, 5, 17])
def test_rows_that_were_put_back_lie_where_they_lay(added):
    one, other = (ReplayBuffer(2, 7, n_step=2) for _ in range(2))
    for buffer in (one, other):
        buffer.prefill(rows_of(2))
    rows = np.stack([np.stack([episode([k])[0], episode([10 * k])[0]]) for k in range(added)] or [rows_of(2)[:0]])
    for row in rows[:added]:
        one.add(row)
    other.restore(rows.reshape(-1, 2, WIDTH), added)
    np.testing.assert_array_equal(one.rows, other.rows)
    np.testing.assert_array_equal(one.newest(100), other.newest(100))
    assert (one.added, len(one)) == (other.added, len(other))


def test_the_newest_rows_come_in_the_order_of_time_and_no_more_than_are_kept():
    buffer = ReplayBuffer(1, 4)
    for number in range(6):
        buffer.add(rows_of(1, first=number))
    assert buffer.newest(2)[:, 0, 4].tolist() == [4, 5]
    assert buffer.newest(100)[:, 0, 4].tolist() == [2, 3, 4, 5]
