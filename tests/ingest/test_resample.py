"""What is on the grid is what was measured; between messages what the policy says; beyond them nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.ingest.grid import ON_GRID_NS, Grid, instants
from maglev_offline.ingest.placing import Bounds, bracket, place, rank
from maglev_offline.ingest.resample import Origin, at_instant, hold, nearest, step_mean

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
GRID = 10 * MS

steps_ns = st.lists(st.integers(1, 30 * MS), min_size=1, max_size=60)
starts_ns = st.one_of(st.integers(-(2**62), 2**62), st.integers(-(10**9), 10**9), st.integers(T0 - GRID, T0 + GRID))
WAYS = (at_instant, hold, nearest, step_mean)


def array(*numbers):
    return np.array(numbers, dtype=np.int64)


def times(start, steps):
    return start + np.concatenate([[0], np.cumsum(np.array(steps, dtype=np.int64))])


def at(t, instants_ns, period=GRID, longest_ns=None):
    """Given instants among the messages at `t`."""
    grid = Grid(np.array(instants_ns, dtype=np.int64), array(0, len(instants_ns)), period)
    return place(t, grid, Bounds(array(0), array(len(t)), array(0)), longest_ns)


def between(t, period=GRID, phase=0):
    """All instants that lie between the messages at `t`."""
    grid = instants(t[:1], t[-1:], array(phase), period)
    return place(t, grid, Bounds(array(0), array(len(t)), array(0)))


def some_values(t, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, len(t))


class TestAll:
    @given(starts_ns, steps_ns)
    def test_every_row_between_the_messages_has_a_value(self, start, steps):
        t = times(start, steps)
        rows = between(t)
        for way in WAYS:
            assert np.isfinite(way(rows, np.ones(len(t)))[0]).all()

    @given(st.lists(st.floats(width=64), min_size=2, max_size=50), starts_ns)
    def test_what_lies_on_the_grid_is_untouched_bit_for_bit(self, values, start):
        t = start + np.arange(len(values)) * GRID
        rows = between(t, phase=start % GRID)
        np.testing.assert_array_equal(rows.grid.t_ns, t)
        for way in WAYS:
            found, origin = way(rows, np.array(values))
            assert found.tobytes() == np.array(values).tobytes()
            assert (origin == Origin.MEASURED).all()

    @given(starts_ns, st.lists(st.integers(-ON_GRID_NS // 2, ON_GRID_NS // 2), min_size=2, max_size=50))
    def test_jitter_below_a_microsecond_leaves_values_as_they_are(self, start, jitter):
        exact = start + np.arange(len(jitter)) * GRID
        values = some_values(jitter)
        rows = at(exact + np.array(jitter), exact)
        for way in WAYS:
            found, origin = way(rows, values)
            np.testing.assert_array_equal(found, values)
            assert (origin == Origin.MEASURED).all()

    @given(steps_ns, st.lists(st.sampled_from([0.0, -0.0, 1.0, np.inf, -np.inf, np.nan, 1e308, -1e308]), min_size=61))
    def test_a_measured_row_beside_others_has_the_bits_of_its_message(self, steps, values):
        t = times(T0 + 300, np.array(steps) // GRID * GRID + np.array(steps) % 2000)
        t, values = t[: len(values)], np.array(values)[: len(t)]
        rows = between(t)
        for way in WAYS:
            found, origin = way(rows, values)
            measured = origin == Origin.MEASURED
            assert found[measured].tobytes() == values[rows.nearest[measured]].tobytes()

    @given(starts_ns, steps_ns, st.sampled_from([MS, GRID, 50 * MS]))
    def test_the_messages_about_an_instant_are_those_before_and_after_it(self, start, steps, period):
        t = times(start, steps)
        rows = between(t, period)
        after = np.searchsorted(t, rows.grid.t_ns).clip(0, len(t) - 1)
        np.testing.assert_array_equal(rows.after, after)
        np.testing.assert_array_equal(rows.before, np.maximum(after - 1, 0))

    @given(starts_ns, steps_ns, st.sampled_from([MS, 2_500_000, GRID, 1000 * MS]))
    def test_resampling_twice_is_resampling_once(self, start, steps, period):
        t = times(start, steps)
        rows = between(t, period)
        if len(rows.grid.t_ns) == 0:
            return
        for way in WAYS:
            once, _ = way(rows, some_values(t))
            twice, origin = way(between(rows.grid.t_ns, period), once)
            assert twice.tobytes() == once.tobytes()
            assert (origin == Origin.MEASURED).all()

    @pytest.mark.parametrize(("late_ns", "there"), [(0, True), (1000, True), (-1000, True), (1001, False)])
    def test_measured_means_within_a_microsecond(self, late_ns, there):
        rows = at(array(T0 - GRID, T0 + late_ns, T0 + GRID), [T0])
        for way in WAYS:
            assert (way(rows, np.array([0.0, 1.0, 0.0]))[1][0] == Origin.MEASURED) == there


class TestAtInstant:
    @given(starts_ns, steps_ns, st.floats(-10, 10), st.floats(-10, 10))
    def test_a_straight_line_is_met_exactly(self, start, steps, slope, level):
        t = times(start, steps)
        rows = between(t)
        values, _ = at_instant(rows, level + slope * (t - t[0]) / 1e9)
        # The microsecond of tolerance about an instant is all that can be off.
        np.testing.assert_allclose(values, level + slope * (rows.grid.t_ns - t[0]) / 1e9, atol=1.1e-5, rtol=0)

    def test_beyond_the_messages_is_nothing(self):
        t = array(T0, T0 + GRID)
        assert np.isnan(at_instant(at(t, [T0 - 1001, T0 + GRID + 1001]), np.ones(2))[0]).all()

    def test_messages_too_far_apart_say_nothing_of_what_lies_between(self):
        t = T0 + array(0, 20, 50) * MS
        rows = at(t, T0 + array(0, 10, 20, 30, 50) * MS, longest_ns=25 * MS)
        values, origin = at_instant(rows, np.array([0.0, 2.0, 5.0]))
        np.testing.assert_array_equal(values, [0, 1, 2, np.nan, 5])
        assert origin[[0, 1, 4]].tolist() == [Origin.MEASURED, Origin.INTERPOLATED, Origin.MEASURED]

    def test_nanoseconds_survive_the_size_of_absolute_time(self):
        rows = at(array(T0, T0 + 4000), [T0 + 1001, T0 + 2000])
        np.testing.assert_allclose(at_instant(rows, np.array([0.0, 4000.0]))[0], [1001, 2000], atol=1e-9)


class TestHold:
    def test_the_latest_message_is_held(self):
        rows = at(T0 + array(0, 12, 30) * MS, T0 + array(0, 10, 20, 30) * MS)
        values, origin = hold(rows, np.array([1.0, 2.0, 3.0]))
        assert values.tolist() == [1, 1, 2, 3]
        assert origin.tolist() == [Origin.MEASURED, Origin.HELD, Origin.HELD, Origin.MEASURED]

    def test_before_the_first_message_is_nothing(self):
        values, _ = hold(at(array(T0, T0 + GRID), [T0 - 1001, T0 + 2 * GRID]), np.array([1.0, 2.0]))
        np.testing.assert_array_equal(values, [np.nan, 2.0])

    def test_a_message_that_jitter_puts_just_behind_an_instant_counts_as_there(self):
        rows = at(T0 + array(0, 11, 30) * MS, T0 + array(0, 10, 20, 30) * MS)
        assert hold(rows, np.array([1.0, 2.0, 3.0]), tolerance_ns=1 * MS)[0].tolist() == [1, 2, 2, 3]

    @given(starts_ns, steps_ns, st.integers(0, 5 * MS))
    def test_it_is_the_last_message_within_the_tolerance(self, start, steps, tolerance):
        t = times(start, steps)
        rows = between(t)
        values, origin = hold(rows, np.arange(len(t), dtype=float), tolerance)
        for instant, value, how in zip(rows.grid.t_ns, values, origin, strict=True):
            if how == Origin.HELD:
                assert value == np.flatnonzero(t <= instant + tolerance)[-1]
            else:
                assert abs(t[int(value)] - instant) <= ON_GRID_NS

    def test_a_message_may_be_too_old(self):
        rows = at(array(T0, T0 + 100 * MS), T0 + array(10, 20, 30) * MS, longest_ns=20 * MS)
        np.testing.assert_array_equal(hold(rows, np.ones(2))[0], [1, 1, np.nan])


def test_the_nearest_message_may_be_of_before_or_after():
    rows = at(T0 + array(0, 12, 30) * MS, T0 + array(0, 10, 20, 30) * MS)
    values, origin = nearest(rows, np.array([1.0, 2.0, 3.0]))
    assert values.tolist() == [1, 2, 2, 3]
    assert origin.tolist() == [Origin.MEASURED, Origin.HELD, Origin.HELD, Origin.MEASURED]


class TestStepMean:
    def test_each_message_counts_for_the_time_that_it_was_held(self):
        t = T0 + array(0, 4, 10, 20, 25) * MS
        values, origin = step_mean(at(t, T0 + array(0, 10, 20) * MS), np.array([1.0, 2.0, 5.0, 7.0, 9.0]))
        np.testing.assert_allclose(values, [1.6, 5.0, 7.0])  # the messages do not reach the end of the last step
        assert origin.tolist() == [Origin.AVERAGED, Origin.MEASURED, Origin.MEASURED]

    @given(starts_ns, st.lists(st.integers(1, 4000), min_size=3, max_size=80), st.integers(0, 2**31))
    def test_it_is_the_integral_over_the_step(self, start, steps_us, seed):
        t = times(start, np.array(steps_us) * 1000)
        v = some_values(t, seed)
        rows = between(t)
        for instant, value, how in zip(rows.grid.t_ns, *step_mean(rows, v), strict=True):
            if how != Origin.AVERAGED:
                continue
            fine = instant + np.arange(500, GRID, 1000)
            expected = v[np.maximum(np.searchsorted(t, fine, side="right") - 1, 0)].mean()
            assert value == pytest.approx(expected, abs=2e-4)


@given(
    st.lists(st.lists(st.integers(1, 9), min_size=1, max_size=9), min_size=1, max_size=5),
    st.integers(0, 40),
    st.sampled_from(["left", "right"]),
)
def test_ranks_of_many_stretches_are_those_of_each(epochs, at_time, side):
    """Epochs in which the times begin anew; each is a stretch, and is asked for the same times."""
    parts = [np.cumsum(steps) for steps in epochs]
    stop = np.cumsum([len(p) for p in parts])
    bounds = Bounds(stop - [len(p) for p in parts], stop, np.arange(len(parts)))
    asked = np.tile(at_time + array(0, 3), len(parts))
    found = rank(np.concatenate(parts), asked, np.arange(len(parts) + 1) * 2, bounds, side)
    expected = [bounds.first[k] + np.searchsorted(p, at_time + array(0, 3), side) for k, p in enumerate(parts)]
    np.testing.assert_array_equal(found, np.concatenate(expected))


class TestBracket:
    def of(self, start, end, **options):
        t = array(0, 10, 20, 30, 40, 50)
        found = bracket(
            t, array(*start), array(*end), Bounds(*(np.repeat(n, len(start)) for n in (0, 6, 0))), **options
        )
        return np.flatnonzero(found).tolist()

    def test_the_messages_about_both_ends_belong_to_a_span(self):
        assert self.of([15], [25]) == [1, 2, 3]
        assert self.of([10], [20]) == [1, 2]

    def test_several_spans(self):
        assert self.of([0, 31], [9, 39]) == [0, 1, 3, 4]

    def test_a_message_that_is_too_far_away_does_not(self):
        assert self.of([14, 0], [15, 0], longest_ns=4) == [0, 1]

    def test_a_kernel_reaches_further(self):
        assert self.of([25], [25], reach_ns=10) == [1, 2, 3, 4]
