"""What is on the grid is what was measured; between messages a straight line; beyond them nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.ingest.resample import ON_GRID_NS, Origin, grid_instants, grid_phase, hold, interpolate

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
GRID = 10 * MS

steps_ns = st.lists(st.integers(1, 30 * MS), min_size=1, max_size=60)
offset_ns = st.integers(-(10**9), 10**9)


def times(offset, steps):
    return T0 + offset + np.concatenate([[0], np.cumsum(np.array(steps, dtype=np.int64))])


def test_grid_instants_are_multiples_of_the_period_in_absolute_time():
    assert grid_instants(T0 - 1 * MS, T0 + 25 * MS, GRID).tolist() == [T0, T0 + GRID, T0 + 2 * GRID]


def test_a_message_that_misses_the_instant_by_a_microsecond_still_makes_a_row():
    assert len(grid_instants(T0 + ON_GRID_NS, T0 + GRID - ON_GRID_NS, GRID)) == 2
    assert len(grid_instants(T0 + ON_GRID_NS + 1, T0 + GRID - ON_GRID_NS - 1, GRID)) == 0


@given(offset_ns, steps_ns)
def test_nothing_is_extrapolated(offset, steps):
    t = times(offset, steps)
    grid = grid_instants(int(t[0]), int(t[-1]), GRID)
    assert (grid % GRID == 0).all()
    assert (grid >= t[0] - ON_GRID_NS).all()
    assert (grid <= t[-1] + ON_GRID_NS).all()
    for way in (interpolate, hold):
        assert np.isfinite(way(t, np.ones(len(t)), grid)[0]).all()
    beyond = np.array([t[0] - 2 * ON_GRID_NS, t[-1] + 2 * ON_GRID_NS])
    assert np.isnan(interpolate(t, np.ones(len(t)), beyond)[0]).all()
    assert np.isnan(hold(t, np.ones(len(t)), beyond)[0][0])


@given(offset_ns, steps_ns, st.floats(-10, 10), st.floats(-10, 10))
def test_a_straight_line_is_met_exactly(offset, steps, slope, level):
    t = times(offset, steps)
    grid = grid_instants(int(t[0]), int(t[-1]), GRID)
    line = level + slope * (t - t[0]) / 1e9
    values, _ = interpolate(t, line, grid)
    # The microsecond of tolerance about an instant is all that can be off.
    np.testing.assert_allclose(values, level + slope * (grid - t[0]) / 1e9, atol=1.1e-5, rtol=0)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=50))
def test_what_lies_on_the_grid_is_untouched(values):
    t = T0 + np.arange(len(values)) * GRID
    grid = grid_instants(int(t[0]), int(t[-1]), GRID)
    np.testing.assert_array_equal(grid, t)
    for way in (interpolate, hold):
        found, origin = way(t, np.array(values), grid)
        np.testing.assert_array_equal(found, values)
        assert (origin == Origin.MEASURED).all()


@given(offset_ns, steps_ns, st.randoms(use_true_random=False))
def test_resampling_twice_is_resampling_once(offset, steps, random):
    t = times(offset, steps)
    grid = grid_instants(int(t[0]), int(t[-1]), GRID)
    if len(grid) == 0:
        return
    values = np.array([random.uniform(-1, 1) for _ in t])
    for way in (interpolate, hold):
        once, _ = way(t, values, grid)
        again = grid_instants(int(grid[0]), int(grid[-1]), GRID)
        np.testing.assert_array_equal(again, grid)
        np.testing.assert_array_equal(way(grid, once, again)[0], once)


@pytest.mark.parametrize(
    ("late_ns", "origin"), [(0, "MEASURED"), (1000, "MEASURED"), (-1000, "MEASURED"), (1001, "INTERPOLATED")]
)
def test_measured_means_within_a_microsecond(late_ns, origin):
    t = np.array([T0 - GRID, T0 + late_ns, T0 + GRID])
    values, found = interpolate(t, np.array([0.0, 1.0, 0.0]), np.array([T0]))
    assert found[0] == Origin[origin]
    assert (values[0] == 1.0) == (origin == "MEASURED")


def test_a_message_that_jitter_puts_just_behind_an_instant_counts_as_there():
    t = T0 + np.array([0, 11, 30]) * MS
    grid = T0 + np.array([0, 10, 20, 30]) * MS
    assert hold(t, np.array([1.0, 2.0, 3.0]), grid, tolerance_ns=1 * MS)[0].tolist() == [1, 2, 2, 3]


@given(offset_ns, st.lists(st.integers(-MS // 2, MS // 2), min_size=5, max_size=60))
def test_the_phase_is_one_that_most_messages_keep_to(offset, jitter):
    t = T0 + offset + np.arange(len(jitter)) * GRID + np.array(jitter)
    off = (t - grid_phase(t, GRID) + GRID // 2) % GRID - GRID // 2
    assert np.abs(off).max() <= MS


@given(offset_ns, st.integers(2, 50))
def test_messages_on_a_grid_give_its_phase_exactly(offset, n):
    t = T0 + offset + np.arange(n) * GRID
    np.testing.assert_array_equal(grid_instants(int(t[0]), int(t[-1]), GRID, grid_phase(t, GRID)), t)


def test_a_source_that_keeps_to_no_phase_gets_that_of_its_first_message():
    t = T0 + 3 * MS + np.arange(100) * MS
    assert grid_phase(t, GRID) == (T0 + 3 * MS) % GRID


def test_a_held_signal_keeps_its_latest_message():
    t = T0 + np.array([0, 12, 30]) * MS
    values, origin = hold(t, np.array([1.0, 2.0, 3.0]), T0 + np.array([0, 10, 20, 30]) * MS)
    assert values.tolist() == [1, 1, 2, 3]
    assert origin.tolist() == [Origin.MEASURED, Origin.HELD, Origin.HELD, Origin.MEASURED]


def test_nanoseconds_survive_the_size_of_absolute_time():
    t = np.array([T0 + 1, T0 + 3])
    values, _ = interpolate(t + 5000, np.array([0.0, 1.0]), np.array([T0 + 5002 - 5000 + 5000]))
    assert 0 <= values[0] <= 1
