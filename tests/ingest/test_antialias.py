"""The low-pass keeps what the grid can hold, takes away what it would fold, and turns no phase."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.ingest.antialias import CUTOFF, HALF_WIDTH, PASS_EDGE, RIPPLE, STOP_EDGE, Filter
from maglev_offline.ingest.grid import instants
from maglev_offline.ingest.placing import Bounds, place
from maglev_offline.ingest.resample import Origin, at_instant, hold

T0 = 1_700_000_000_000_000_000
GRID = 100_000_000
DECISION = Path(__file__).parents[2] / "docs/decisions/0008-resampling.md"


def array(*numbers):
    return np.array(numbers, dtype=np.int64)


def messages(ratio, *, jitter=0.0, periods=200, seed=0, lost=0.0):
    """Times of a source `ratio` times as fast as the grid; jitter as a share of its period, uniform to both sides."""
    rng = np.random.default_rng(seed)
    step = GRID / ratio
    n = int(periods * ratio)
    t = T0 + np.round(np.arange(n) * step + rng.uniform(-jitter, jitter, n) * step).astype(np.int64)
    return t[rng.uniform(size=n) >= lost]


def place_of(t, phase=0):
    grid = instants(t[:1], t[-1:], array(phase), GRID)
    return place(t, grid, Bounds(array(0), array(len(t)), array(0)))


def gains(rows, way, cycles):
    """The complex gain of each row for a sine of `cycles` for a grid period, and the rows' origins.

    The gain less one is the greatest error that a sine of amplitude one can have there, whatever its phase.
    """
    turn = 2j * np.pi * cycles / GRID
    wave = np.exp(turn * (rows.t_ns - T0))
    (real, origin), (imaginary, _) = way(rows, wave.real), way(rows, wave.imag)
    return (real + 1j * imaginary) * np.exp(-turn * (rows.grid.t_ns - T0)), origin


def whole(rows, cycles):
    low_pass = Filter(rows)
    gain, origin = gains(rows, lambda _, values: low_pass(values), cycles)
    return gain[origin == Origin.FILTERED]


@pytest.mark.parametrize("ratio", [1.6, 2, 5, 10, 100])
class TestRegular:
    @pytest.mark.parametrize("cycles", [0.001, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, PASS_EDGE])
    def test_what_the_grid_can_hold_stays_at_any_phase(self, ratio, cycles):
        rows = place_of(messages(ratio))
        assert len(whole(rows, cycles)) > 150
        assert np.abs(whole(rows, cycles) - 1).max() < RIPPLE

    @pytest.mark.parametrize("cycles", [STOP_EDGE, 0.55, 0.73, 0.9, 1.3, 2.1, 4.4, 30.0])
    def test_what_it_would_fold_goes(self, ratio, cycles):
        if cycles < ratio / 2:  # above this the source itself has folded it
            assert np.abs(whole(place_of(messages(ratio)), cycles)).max() < (RIPPLE if ratio < 2 else 1e-3)

    def test_the_gain_at_the_cut_off_is_one_half(self, ratio):
        np.testing.assert_allclose(whole(place_of(messages(ratio)), CUTOFF), 0.5, atol=0.002)


@settings(deadline=None, max_examples=30)
@given(st.floats(1.6, 20), st.floats(0, 0.45), st.floats(0, 0.1), st.integers(0, 2**31), st.floats(-1e3, 1e3))
def test_what_is_at_rest_stays_whatever_the_times(ratio, jitter, lost, seed, level):
    t = messages(ratio, jitter=jitter, lost=lost, seed=seed, periods=40)
    values, _ = Filter(place_of(t))(np.full(len(t), level))
    np.testing.assert_allclose(values, level, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("phase", [0, 12_345_678, 50_000_000])
def test_a_ramp_is_met_at_every_instant_as_no_phase_is_turned(phase):
    rows = place_of(messages(10), phase)
    values, _ = Filter(rows)((rows.t_ns - T0) / 1e9)
    np.testing.assert_allclose(values, (rows.grid.t_ns - T0) / 1e9, atol=1e-4)


def test_rows_that_the_whole_kernel_does_not_fit_about_do_not_say_filtered():
    rows = place_of(messages(10, periods=50))
    _, origin = Filter(rows)(np.zeros(len(rows.t_ns)))
    filtered = np.flatnonzero(origin == Origin.FILTERED)
    assert filtered.tolist() == list(range(int(HALF_WIDTH), len(origin) - int(HALF_WIDTH)))


def test_the_first_and_the_last_row_have_the_value_at_their_instant():
    rows = place_of(messages(10, periods=50))
    noise = np.random.default_rng(0).normal(size=len(rows.t_ns))
    values, _ = Filter(rows)(noise)
    plain, _ = at_instant(rows, noise)
    assert values[[0, -1]].tolist() == plain[[0, -1]].tolist()
    assert np.std(values[8:-8]) < 0.4 * np.std(plain)


def test_nothing_is_filtered_across_a_silence_longer_than_a_period():
    t = messages(10, periods=60)
    t = t[(t < T0 + 29.95 * GRID) | (t > T0 + 31.95 * GRID)]
    step = np.where(t < T0 + 30 * GRID, 0.0, 1.0)
    values, origin = Filter(place_of(t))(step)
    np.testing.assert_allclose(values[:30], 0, atol=1e-12)
    np.testing.assert_allclose(values[32:], 1, atol=1e-12)
    assert (origin[22:40] != Origin.FILTERED).all()


def test_a_missing_value_is_done_without_and_many_are_not():
    t = messages(10, periods=60)
    values = np.ones(len(t))
    values[200] = np.nan
    values[400:425] = np.nan
    found, _ = Filter(place_of(t))(values)
    assert np.isfinite(found[:34]).all()
    assert np.isnan(found[41])
    np.testing.assert_allclose(found[np.isfinite(found)], 1)


def table_of(heading):
    """Numbers of the table below a heading of the decision."""
    section = DECISION.read_text(encoding="utf-8").split(heading)[1].split("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")][2:]
    return [[float(cell) for cell in line.strip("|").split("|")] for line in lines]


def test_the_errors_of_the_filter_in_the_decision_are_those_of_the_code():
    table = table_of("## Error of `filtered`")
    assert len(table) >= 8
    for cycles, at_100_ms_hz, *stated in table:
        assert at_100_ms_hz == pytest.approx(cycles * 10)
        sources = [messages(10), messages(10, jitter=0.1), messages(3, jitter=0.1)]
        for source, number in zip(sources, stated, strict=True):
            wanted = 0.0 if cycles >= STOP_EDGE else 1.0
            assert np.abs(whole(place_of(source), cycles) - wanted).max() == pytest.approx(number, rel=0.15, abs=1e-4)


def test_the_errors_of_straight_lines_and_held_values_in_the_decision_are_those_of_the_code():
    table = table_of("## Error of `instant`")
    assert len(table) >= 5
    for cycles, at_100_ms_hz, middle, late, held in table:
        assert at_100_ms_hz == pytest.approx(cycles * 10)
        t = T0 + np.arange(100) * GRID
        for phase, way, number in ((GRID // 2, at_instant, middle), (3 * GRID // 100, at_instant, late),
                                   (GRID - 2000, hold, held)):  # fmt: skip
            gain, _ = gains(place_of(t, phase), way, cycles)
            assert np.abs(gain - 1).max() == pytest.approx(number, rel=0.02, abs=6e-5)
