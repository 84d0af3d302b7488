"""The grid is uniform in integer nanoseconds, has the phase of the messages, and does not reach beyond them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.ingest.grid import ON_GRID_NS, instants, phases

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
GRID = 10 * MS

starts_ns = st.one_of(st.integers(-(2**62), 2**62), st.integers(-(10**10), 10**10), st.just(T0))
periods_ns = st.sampled_from([MS, 2_500_000, 333_333_333, 100 * MS, 1000 * MS, 1_234_567])


def array(*numbers):
    return np.array(numbers, dtype=np.int64)


def grid_of(start, end, period=GRID, phase=0):
    return instants(array(start), array(end), array(phase), period).t_ns


def phase_of(t, period=GRID):
    return int(phases(t, array(0), array(len(t)), period)[0])


def test_instants_are_multiples_of_the_period_in_absolute_time():
    assert grid_of(T0 - 1 * MS, T0 + 25 * MS).tolist() == [T0, T0 + GRID, T0 + 2 * GRID]


def test_a_message_that_misses_the_instant_by_a_microsecond_still_makes_a_row():
    assert len(grid_of(T0 + ON_GRID_NS, T0 + GRID - ON_GRID_NS)) == 2
    assert len(grid_of(T0 + ON_GRID_NS + 1, T0 + GRID - ON_GRID_NS - 1)) == 0


@given(starts_ns, st.integers(0, 10**10), periods_ns, st.data())
def test_every_instant_of_the_phase_and_no_other_lies_between_the_ends(start, length, period, data):
    phase = data.draw(st.integers(0, period - 1))
    found = grid_of(start, start + length, period, phase)
    first = -((phase + ON_GRID_NS - start) // period) * period + phase
    assert found.tolist() == list(range(first, start + length + ON_GRID_NS + 1, period))


@given(st.lists(st.tuples(st.integers(0, 10**8), st.integers(0, GRID - 1)), max_size=8))
def test_stretches_are_each_as_if_alone(spans):
    start = T0 + np.arange(len(spans)) * 10**9
    end = start + array(*(length for length, _ in spans))
    phase = array(*(p for _, p in spans))
    grid = instants(start, end, phase, GRID)
    assert grid.begin[-1] == len(grid.t_ns)
    for k in range(len(spans)):
        alone = grid_of(start[k], end[k], GRID, phase[k])
        np.testing.assert_array_equal(grid.t_ns[grid.begin[k] : grid.begin[k + 1]], alone)
    np.testing.assert_array_equal(
        np.broadcast_to(grid.spread(start), grid.t_ns.shape), np.repeat(start, grid.rows), strict=True
    )


@given(starts_ns, periods_ns, st.integers(2, 50))
def test_messages_on_a_grid_give_its_phase_exactly(start, period, n):
    t = start + np.arange(n) * period
    np.testing.assert_array_equal(grid_of(t[0], t[-1], period, phase_of(t, period)), t)


@given(starts_ns, st.lists(st.integers(-MS // 2, MS // 2), min_size=5, max_size=60))
def test_the_phase_is_one_that_most_messages_keep_to(start, jitter):
    t = start + np.arange(len(jitter)) * GRID + np.array(jitter)
    off = (t - phase_of(t) + GRID // 2) % GRID - GRID // 2
    assert np.abs(off).max() <= MS


@pytest.mark.parametrize("late_ms", [3, 4.9, 5, 5.1, 7])
def test_a_first_message_that_is_late_does_not_give_the_phase(late_ms):
    t = T0 + np.arange(50) * GRID + np.tile([0, 200_000, -300_000, 100_000, -100_000], 10)
    t[0] += int(late_ms * MS)
    off = (phase_of(t) - T0 + GRID // 2) % GRID - GRID // 2
    assert abs(off) <= 300_000


def test_a_source_that_keeps_to_no_phase_gets_that_of_its_first_message():
    t = T0 + 3 * MS + np.arange(100) * MS
    assert phase_of(t) == (T0 + 3 * MS) % GRID


@given(st.lists(st.lists(st.integers(1, 30 * MS), min_size=1, max_size=12), min_size=1, max_size=6))
def test_each_stretch_has_the_phase_that_it_has_alone(stretches):
    parts = [T0 + k * 10**10 + np.cumsum(steps) for k, steps in enumerate(stretches)]
    stop = np.cumsum([len(part) for part in parts])
    first = stop - [len(part) for part in parts]
    found = phases(np.concatenate(parts), first, stop, GRID)
    assert found.tolist() == [phase_of(part) for part in parts]


def test_nothing_of_nothing():
    none = array()
    assert len(phases(none, none, none, GRID)) == 0
    assert len(instants(none, none, none, GRID).t_ns) == 0
