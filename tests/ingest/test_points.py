"""One point: its rows, where they come from, and that every message and every row is accounted for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from maglev_offline.ingest import segments
from maglev_offline.ingest.points import assemble
from maglev_offline.ingest.resample import Origin
from maglev_offline.ingest.settings import IngestSettings, ResampleSettings
from maglev_offline.ingest.topics import CleanTopic
from maglev_offline.physics.dynamics import in_contact
from maglev_offline.physics.parameters import Plant

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
PLANT = Plant()
STATE = ("gap", "velocity", "current", "voltage")


def using(grid_ms=10, bridge_ms=25, **resample):
    return IngestSettings(grid_ms=grid_ms, longest_bridge_ms=bridge_ms, resample=ResampleSettings(**resample))


def topic(name, t_ns, values, *, bridge_ms=25, epoch=None, file_index=None):
    t = np.asarray(t_ns, dtype=np.int64)
    epoch = np.zeros(len(t), np.int32) if epoch is None else np.asarray(epoch, np.int32)
    places = np.arange(len(t)) if file_index is None else np.asarray(file_index)
    found = segments.stretches(t, segments.stretch_of(t, epoch, round(bridge_ms * MS)), epoch, places)
    values = {name: np.broadcast_to(np.asarray(v, dtype=float), t.shape) for name, v in values.items()}
    return CleanTopic(name, ("F1",), t, places, values, found, 0)


def state(t_ms, *, gap=0.008, **options):
    t = T0 + np.round(np.asarray(t_ms) * MS).astype(np.int64)
    n = np.arange(len(t), dtype=float)
    return topic("/F1", t, {"gap": gap, "velocity": n, "current": n, "voltage": n}, **options)


def assembled(settings, *topics):
    by_name = {made.topic: made for made in topics}
    sources = {signal: made.topic for made in topics for signal in made.values}
    return assemble("F1", sources, by_name, settings, PLANT)


def speed(t_ms, values, bridge_ms=2500):
    return topic("/vehicle", T0 + np.asarray(t_ms) * MS, {"speed_m_s": values}, bridge_ms=bridge_ms)


class TestContext:
    def test_a_speed_at_1_hz_breaks_no_stretch(self):
        made = assembled(using(), state(range(0, 3000, 10)), speed([0, 1000, 2000, 3000], [0.0, 10, 20, 30]))
        assert len(made.t_ns) == 300
        assert made.segment.max() == 0
        np.testing.assert_allclose(made.values["speed_m_s"], np.arange(300) / 10)
        assert np.flatnonzero(made.origins["speed_m_s"] == Origin.MEASURED).tolist() == [0, 100, 200]
        assert made.used["/vehicle"].all()

    def test_it_may_be_held(self):
        made = assembled(using(columns={"speed_m_s": "hold"}), state(range(0, 2000, 10)), speed([0, 1000], [1.0, 2]))
        assert made.values["speed_m_s"].tolist() == [1.0] * 100 + [2.0] * 100
        assert set(made.origins["speed_m_s"]) == {Origin.MEASURED, Origin.HELD}

    def test_beyond_its_messages_and_across_a_long_silence_it_is_unknown(self):
        made = assembled(
            using(context_bridge_ms=300), state(range(0, 1000, 10)), speed([100, 200, 600, 800], [1.0] * 4)
        )
        known = np.flatnonzero(np.isfinite(made.values["speed_m_s"]))
        assert known.tolist() == [*range(10, 21), *range(60, 81)]
        assert len(made.t_ns) == 100

    def test_messages_from_elsewhere_in_time_are_not_used(self):
        made = assembled(using(context_bridge_ms=300), state(range(5000, 6000, 10)), speed([0, 4800, 5500, 9000], 1.0))
        assert made.used["/vehicle"].tolist() == [False, True, True, False]
        assert made.within["/vehicle"].tolist() == [False, True, True, False]

    def test_a_topic_without_messages_leaves_its_column_empty(self):
        made = assembled(using(), state(range(0, 100, 10)), speed(np.empty(0, int), []))
        assert len(made.t_ns) == 10
        assert np.isnan(made.values["speed_m_s"]).all()

    def test_after_a_reset_it_is_that_of_after_the_reset(self):
        twice = np.tile(np.arange(0, 100, 10), 2)
        of_state = state(twice, epoch=np.repeat([0, 1], 10), file_index=np.arange(20) * 2)
        other = topic("/vehicle", T0 + twice * MS, {"speed_m_s": np.repeat([1.0, 2.0], 10)},
                      epoch=np.repeat([0, 1], 10), file_index=np.arange(20) * 2 + 1)  # fmt: skip
        made = assembled(using(), of_state, other)
        assert made.values["speed_m_s"].tolist() == [1.0] * 10 + [2.0] * 10

    @pytest.mark.parametrize("first", [0, 1])
    def test_of_several_epochs_it_is_the_one_that_covers_most_of_the_stretch(self, first):
        t = np.array([np.arange(0, 200, 10), np.arange(150, 350, 10)])
        v = np.array([np.full(20, 1.0), np.full(20, 2.0)])
        order = [first, 1 - first]
        other = topic("/vehicle", T0 + t[order].ravel() * MS, {"speed_m_s": v[order].ravel()},
                      epoch=np.repeat([0, 1], 20))  # fmt: skip
        made = assembled(using(), state(range(0, 200, 10)), other)
        assert set(made.values["speed_m_s"]) == {1.0}


class TestPolicies:
    def test_a_fast_state_is_taken_at_its_instant_and_not_filtered(self):
        t = np.arange(0, 1000, 1)
        made = assembled(using(), state(t, gap=0.008 + 1e-4 * np.sin(t)))
        np.testing.assert_array_equal(made.values["gap_m"], 0.008 + 1e-4 * np.sin(t[::10]))
        assert made.faster == STATE
        assert set(made.origins["gap_m"]) == {Origin.MEASURED}

    def test_fast_context_is_filtered_and_slow_context_is_not(self):
        t = np.arange(0, 2000, 1)
        fast = topic("/vehicle", T0 + t * MS, {"speed_m_s": 10 + np.sin(2 * np.pi * 0.3 * t)})
        made = assembled(using(), state(np.arange(0, 2000, 10)), fast)
        inner = made.origins["speed_m_s"] == Origin.FILTERED
        assert inner.sum() > 150
        assert np.abs(made.values["speed_m_s"][inner] - 10).max() < 1e-3

    def test_a_policy_for_each_signal(self):
        policies = {"gap": "filtered", "velocity": "nearest", "current": "mean", "voltage": "mean"}
        made = assembled(using(**policies), state(np.arange(0, 1000, 1)))
        middle = slice(20, 80)
        assert set(made.origins["gap_m"][middle]) == {Origin.FILTERED}
        np.testing.assert_allclose(made.values["gap_m"], 0.008)
        assert made.values["gap_velocity_m_s"][3] == 30
        np.testing.assert_allclose(made.values["voltage_v"][middle], np.arange(200, 800, 10) + 4.5)
        assert set(made.origins["voltage_v"][middle]) == {Origin.AVERAGED}

    def test_without_a_faster_source_they_are_the_plain_ones(self):
        policies = {"gap": "filtered", "current": "mean", "voltage": "mean"}
        t = np.arange(0, 1000, 10) + np.tile([0, 0.3, -0.2, 0, 0], 20)
        fancy, plain = assembled(using(**policies), state(t)), assembled(using(current="hold"), state(t))
        for name, column in plain.values.items():
            assert fancy.values[name].tobytes() == column.tobytes()

    def test_a_held_value_of_a_fast_source_is_not_one_of_later(self):
        gap = topic("/gap", T0 + np.arange(0, 2000, 100) * MS, {"gap": 0.008}, bridge_ms=250)
        t = np.arange(-999.6, 3000, 1)
        coil = topic("/coil", T0 + np.round(t * MS).astype(np.int64), {"current": t, "voltage": t})
        made = assembled(using(grid_ms=100, bridge_ms=250), gap, coil)
        np.testing.assert_allclose(made.values["voltage_v"], np.arange(0, 2000, 100) - 0.6)

    def test_rows_of_a_slow_source_say_that_they_are_not_measured(self):
        made = assembled(using(), state(range(0, 200, 20)))
        assert made.slower == STATE
        assert made.origins["gap_m"].tolist() == [Origin.MEASURED, Origin.INTERPOLATED] * 9 + [Origin.MEASURED]
        assert made.origins["voltage_v"].tolist() == [Origin.MEASURED, Origin.HELD] * 9 + [Origin.MEASURED]

    def test_they_may_be_left_out_and_are_in_the_ledger(self):
        made = assembled(using(slower="leave_out"), state(range(0, 200, 20)))
        assert len(made.t_ns) == 0
        assert {entry.code: entry.total for entry in made.entries} == {
            "between_messages": 9, "contact": 0, "lone_sample": 10,
        }  # fmt: skip
        burst = np.sort(np.append(np.arange(0, 2000, 20), [500 + 10, 500 + 30]))
        made = assembled(using(slower="leave_out"), state(burst))
        np.testing.assert_array_equal((made.t_ns - T0) // MS, np.arange(500, 550, 10))
        assert set(made.origins["gap_m"]) == {Origin.MEASURED}

    def test_a_lost_message_makes_no_source_slow(self):
        made = assembled(using(slower="leave_out"), state([0, 10, 30, 40, 50, 60]))
        assert len(made.t_ns) == 7


class TestContact:
    def test_a_message_a_microsecond_late_is_a_contact_once(self):
        gap = np.full(50, 0.008)
        gap[20] = 0.016
        made = assembled(using(), state(np.arange(0, 500, 10) + np.where(np.arange(50) == 20, 5e-4, 0), gap=gap))
        assert np.flatnonzero(made.contact).tolist() == [20]
        assert len(made.t_ns) == 50

    def test_a_bounce_after_a_hole_stays_in_its_stretch(self):
        t = np.concatenate([np.arange(0, 200), np.arange(300, 500)])
        gap = np.full(400, 0.008)
        gap[203] = 0.0005
        made = assembled(using(), state(t, gap=gap))
        assert ((made.t_ns - T0) // MS)[made.contact].tolist() == [310]


@pytest.mark.parametrize("grid_ms", [2.5, 333.333333, 1, 1000, 12.345678])
def test_a_grid_may_be_any_whole_number_of_nanoseconds(grid_ms):
    assert IngestSettings(grid_ms=grid_ms).grid_ns == round(grid_ms * 1e6)
    period = round(grid_ms * 1e6)
    t = T0 + 17 + np.arange(30, dtype=np.int64) * period
    flat = topic("/F1", t, dict.fromkeys(STATE, 0.008), bridge_ms=2 * grid_ms)
    np.testing.assert_array_equal(assembled(using(grid_ms=grid_ms), flat).t_ns, t)


@pytest.mark.parametrize("grid_ms", [1000 / 3, 0.5, 1001, 2.5000001])
def test_any_other_grid_is_refused(grid_ms):
    with pytest.raises(ValidationError):
        IngestSettings(grid_ms=grid_ms)


def again(made, settings):
    """The rows of a point as the messages of a log, and what comes of them."""
    bridge_ms = settings.longest_bridge_ms
    names = {"gap": "gap_m", "velocity": "gap_velocity_m_s", "current": "current_a", "voltage": "voltage_v"}
    values = {signal: made.values[column] for signal, column in names.items()}
    values["speed_m_s"] = made.values["speed_m_s"]
    return assembled(settings, topic("/F1", made.t_ns, values, bridge_ms=bridge_ms, epoch=made.segment))


@settings(deadline=None, max_examples=150)
@given(
    start=st.sampled_from([T0, -(2**61), 2**62, -5 * MS, 12_345]),
    steps_us=st.lists(st.integers(1, 30_000), min_size=3, max_size=80),
    few_steps=st.sampled_from([1, 10, 40]),
    grid_ms=st.sampled_from([1, 2.5, 7, 10, 33.333333]),
    policy=st.sampled_from(["instant", "nearest", "hold", "mean", "filtered"]),
    seed=st.integers(0, 2**31),
)
def test_rows_resampled_are_themselves_bit_for_bit(start, steps_us, few_steps, grid_ms, policy, seed):
    rng = np.random.default_rng(seed)
    t = start + np.cumsum(np.array(steps_us) // few_steps + 1) * 1000 + rng.integers(-400, 400, len(steps_us))
    gap = np.where(rng.uniform(size=len(t)) < 0.05, 0.0161, 0.008 + 1e-4 * rng.normal(size=len(t)))
    values = {"gap": gap, **{s: rng.normal(size=len(t)) for s in ("velocity", "current", "voltage")}}
    using_it = using(grid_ms, 40, gap=policy, velocity=policy, current=policy, voltage=policy, context=policy)
    context_t = t[:: rng.integers(1, 5)]
    context = {"speed_m_s": rng.normal(size=len(context_t))}
    vehicle = topic("/vehicle", context_t, context, bridge_ms=2500)
    made = assembled(using_it, topic("/F1", t, values, bridge_ms=40), vehicle)
    for name, mask in made.used.items():
        assert (mask <= made.within[name]).all()
    assert made.grid_rows == len(made.t_ns) + sum(entry.total for entry in made.entries)
    assert all(np.isfinite(made.values[name]).all() for name in ("gap_m", "current_a", "voltage_v"))
    if len(made.t_ns) == 0:
        return
    if (made.contact != in_contact(PLANT, made.values["gap_m"], 0.0)).any():
        return  # a bounce between two rows, which the rows' own gaps do not show
    twice = again(made, using_it)
    np.testing.assert_array_equal(twice.t_ns, made.t_ns)
    np.testing.assert_array_equal(twice.segment, made.segment)
    for name, column in made.values.items():
        assert twice.values[name].tobytes() == column.tobytes(), name
