"""One log from messages to samples: defects put in at known places are found there, and nothing is lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.errors import LogError
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.signals import SignalMap
from maglev_offline.physics.parameters import Plant

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
REGULAR = list(range(0, 500, 10))


def value(gap_mm=8.0, current=20.0, voltage=24.0, **more):
    return {"gap_mm": gap_mm, "coil_current_a": current, "coil_voltage_v": voltage, **more}


@pytest.fixture
def ingest(tmp_path, write_log, plant, grid_10, ingest_path):
    """Write a log and ingest it; returns samples and quarantine as data frames and the whole result."""

    def run(t_ms, gap_mm=None, *, signals=None, using=grid_10, of=plant, **options):
        path = write_log(tmp_path / "a.mcap", t_ms, gap_mm, **options)
        made = ingest_path(path, log_id="a-1", signals=signals, settings=using, plant=of)
        return made.samples.to_pandas(), made.quarantine.to_pandas(), made

    return run


def found_at(quarantine, code):
    """Message indices of one code."""
    return quarantine.loc[quarantine["code"] == code, "message_index"].tolist()


class TestSamples:
    def test_a_regular_log_on_its_own_grid_is_kept_as_it_is(self, ingest):
        gap = 8 + 0.1 * np.sin(np.arange(50))
        samples, quarantine, made = ingest(REGULAR, gap)
        assert list(samples.columns) == [
            "log_id", "point", "t", "segment", "step", "gap_m", "gap_velocity_m_s", "current_a", "voltage_v",
            "set_point_m", "gap_origin", "gap_velocity_origin", "current_origin", "voltage_origin", "contact",
        ]  # fmt: skip
        assert len(samples) == 50
        assert len(quarantine) == 0
        assert set(samples["point"]) == {"F1"}
        np.testing.assert_array_equal(samples["t"].astype("int64"), T0 + np.array(REGULAR) * MS)
        np.testing.assert_array_equal(samples["gap_m"], gap / 1e3)
        np.testing.assert_allclose(samples["gap_velocity_m_s"], np.gradient(gap * 1e-3, 0.01), atol=1e-15)
        assert samples["step"].tolist() == list(range(50))
        assert set(samples["segment"]) == {0}
        assert set(samples["gap_origin"]) == {"measured"}
        assert set(samples["gap_velocity_origin"]) == {"reconstructed"}
        assert made.facts["set_point"] == "plant"
        assert set(samples["set_point_m"]) == {0.008}

    def test_messages_between_instants_are_interpolated_and_the_voltage_held(self, ingest):
        values = [value(8, 20, 1), value(8, 20, 2), value(9.5, 23, 3), value(8, 20, 4), value(8, 20, 5)]
        samples, _, _ = ingest([0, 10, 25, 30, 40], values=values)
        row = samples.iloc[2]
        np.testing.assert_allclose([row["gap_m"], row["current_a"]], [0.009, 22])
        assert row["voltage_v"] == 2
        assert [row["gap_origin"], row["voltage_origin"]] == ["interpolated", "held"]

    def test_the_grid_takes_the_phase_of_the_messages_so_that_jitter_alone_is_interpolated(self, ingest):
        t_ms = 5 + np.arange(40) * 10 + np.tile([0, 0.3, -0.4, 0, 0], 8)
        volts = np.arange(40.0)
        samples, _, _ = ingest(t_ms, values=[value(8, 20, v) for v in volts])
        instants = samples["t"].astype("int64").to_numpy()
        assert set((instants - T0) % (10 * MS)) == {5 * MS}
        assert samples["voltage_v"].tolist() == volts.tolist()

    def test_a_logged_velocity_a_set_point_and_context_are_taken(self, ingest):
        values = [value(gap_velocity_mm_s=5.0, set_point_mm=9.0, speed_km_h=36.0, load_kg=700.0)] * 5
        samples, _, made = ingest(range(0, 50, 10), values=values)
        assert samples["gap_velocity_m_s"].tolist() == [0.005] * 5
        assert set(samples["gap_velocity_origin"]) == {"measured"}
        assert samples["set_point_m"].tolist() == [0.009] * 5
        np.testing.assert_allclose(samples["speed_m_s"], 10.0)
        assert set(samples["load_kg"]) == {700.0}
        assert made.facts["velocity"] == "logged"
        assert made.facts["context"] == ["speed_m_s", "load_kg"]

    def test_central_differences_may_be_asked_for(self, ingest):
        using = IngestSettings(grid_ms=10, velocity="central_difference")
        samples, _, made = ingest(range(0, 50, 10), values=[value(gap_velocity_mm_s=5.0)] * 5, using=using)
        assert samples["gap_velocity_m_s"].tolist() == [0.0] * 5
        assert made.facts["velocity"] == "central_difference"

    def test_a_velocity_that_is_not_logged_cannot_be_taken(self, ingest):
        with pytest.raises(LogError, match="wants the logged velocity"):
            ingest(REGULAR, using=IngestSettings(grid_ms=10, velocity="logged"))

    def test_the_header_clock(self, ingest, mcap_files):
        signals = SignalMap.model_validate(
            {
                "topic": "/suspension/(?P<point>[^/]+)/state",
                "clock": "header",
                "clock_field": "stamp",
                "gap": {"field": "gap_mm", "unit": "mm"},
                "current": {"field": "coil_current_a", "unit": "A"},
                "voltage": {"field": "coil_voltage_v", "unit": "V"},
            }
        )
        stamps = [mcap_files.Stamp(1_700_000_000, k * 10 * MS) for k in range(6)]
        values = [value(stamp=stamp) for stamp in stamps]
        values[3] = value()
        samples, quarantine, _ = ingest(np.cumsum([0, 13, 2, 17, 9, 1]), values=values, signals=signals)
        np.testing.assert_array_equal(samples["t"].astype("int64"), T0 + np.arange(6) * 10 * MS)
        assert found_at(quarantine, "no_time") == [3]
        assert samples["gap_origin"].tolist()[3] == "bridged"


class TestDefects:
    def test_a_repeated_message(self, ingest):
        t = REGULAR.copy()
        t.insert(20, t[19])
        values = [value()] * len(t)
        samples, quarantine, _ = ingest(t, values=values)
        assert len(samples) == 50
        assert found_at(quarantine, "repeated_message") == [20]

    def test_a_time_conflict_keeps_the_first(self, ingest):
        t = REGULAR.copy()
        t.insert(20, t[19])
        values = [value(8.0)] * len(t)
        values[20] = value(9.0)
        samples, quarantine, _ = ingest(t, values=values)
        assert found_at(quarantine, "time_conflict") == [20]
        assert set(samples["gap_m"]) == {0.008}

    def test_a_hole_ends_a_segment_and_is_not_bridged(self, ingest):
        t = [*range(0, 200, 10), *range(300, 500, 10)]
        samples, quarantine, _ = ingest(t)
        assert samples.groupby("segment").size().tolist() == [20, 20]
        assert len(samples) == 40
        assert len(quarantine) == 0

    def test_a_short_silence_is_bridged_and_said(self, ingest):
        samples, _, _ = ingest([0, 10, 30, 40])
        assert samples["gap_origin"].tolist() == ["measured", "measured", "interpolated", "measured", "measured"]

    def test_a_single_message_between_two_holes(self, ingest):
        t = [*range(0, 200, 10), 300, *range(400, 500, 10)]
        samples, quarantine, _ = ingest(t)
        assert found_at(quarantine, "too_short") == [20]
        assert set(samples["segment"]) == {0, 1}

    def test_a_reset_of_the_clock_begins_a_segment(self, ingest):
        samples, quarantine, made = ingest([*range(1000, 1200, 10), *range(0, 200, 10)])
        assert samples.groupby("segment").size().tolist() == [20, 20]
        assert samples["t"].astype("int64").iloc[20] == T0
        assert len(quarantine) == 0
        assert made.facts["topics"]["/suspension/F1/state"]["resets"] == 1

    def test_the_same_times_after_a_reset_are_no_repeats(self, ingest):
        samples, quarantine, _ = ingest([*REGULAR, *REGULAR], values=[value()] * 100)
        assert len(samples) == 100
        assert len(quarantine) == 0

    def test_a_late_message_is_sorted_in(self, ingest):
        t = REGULAR.copy()
        t.insert(23, t.pop(20))
        gap = 8 + np.array(t) / 1000
        samples, quarantine, _ = ingest(t, gap)
        assert len(quarantine) == 0
        assert set(samples["segment"]) == {0}
        np.testing.assert_allclose(np.diff(samples["gap_m"]), 1e-5)

    @pytest.mark.parametrize("bad", [float("nan"), float("inf"), None, "8.0"])
    def test_a_value_that_is_no_number(self, ingest, bad):
        values = [value() for _ in REGULAR]
        values[7] = value(bad)
        samples, quarantine, _ = ingest(REGULAR, values=values)
        assert found_at(quarantine, "not_finite") == [7]
        assert quarantine["detail"].tolist() == ["gap"]
        assert samples["gap_origin"].tolist()[7] == "bridged"

    def test_a_missing_context_value_costs_no_message(self, ingest):
        values = [value(load_kg=700.0) for _ in REGULAR]
        values[7] = value()
        samples, quarantine, _ = ingest(REGULAR, values=values)
        assert len(quarantine) == 0
        assert samples["load_kg"].isna().sum() == 1

    def test_values_outside_the_valid_range(self, ingest):
        signals = SignalMap.model_validate(
            {
                "topic": "/suspension/(?P<point>[^/]+)/state",
                "gap": {"field": "gap_mm", "unit": "mm", "valid": (0.0, 20.0)},
                "current": {"field": "coil_current_a", "unit": "A"},
                "voltage": {"field": "coil_voltage_v", "unit": "V"},
            }
        )
        gap = np.full(50, 8.0)
        gap[[3, 30]] = [-1.0, 25.0]
        _, quarantine, _ = ingest(REGULAR, gap, signals=signals)
        assert found_at(quarantine, "out_of_range") == [3, 30]
        assert quarantine["detail"].tolist() == ["gap", "gap"]

    def test_contact_ends_a_segment_and_the_rest_of_the_run_goes(self, ingest):
        gap = np.full(50, 8.0)
        gap[20:25] = 16.0
        samples, quarantine, made = ingest(REGULAR, gap)
        assert samples.groupby("segment").size().tolist() == [21, 25]
        assert np.flatnonzero(samples["contact"]).tolist() == [20]
        contact = quarantine[quarantine["code"] == "contact"]
        assert set(contact["level"]) == {"sample"}
        np.testing.assert_array_equal(contact["t"].astype("int64"), T0 + np.array([210, 220, 230, 240]) * MS)
        assert made.counts["contacts"] == 1

    def test_contact_within_the_tolerance(self, ingest):
        gap = np.full(50, 8.0)
        gap[20] = 15.9
        assert not ingest(REGULAR, gap)[0]["contact"].any()
        using = IngestSettings(grid_ms=10, contact_tolerance_m=0.0002)
        assert ingest(REGULAR, gap, using=using)[0]["contact"].sum() == 1

    def test_a_bounce_between_two_instants_is_a_contact(self, ingest):
        gap = np.full(500, 8.0)
        gap[[254, 255]] = 0.4
        samples, _, _ = ingest(range(500), gap)
        assert samples["t"][samples["contact"]].astype("int64").tolist() == [T0 + 260 * MS]

    def test_a_row_alone_in_its_segment_goes(self, ingest):
        gap = np.full(50, 8.0)
        gap[[20, 21, 23, 24]] = 16.0
        samples, quarantine, _ = ingest(REGULAR, gap)
        assert samples.groupby("segment").size().tolist() == [21, 2, 25]
        gap[[22]] = 16.0
        gap[[48]] = 16.0
        samples, quarantine, _ = ingest(REGULAR, gap)
        assert quarantine["code"].value_counts().to_dict() == {"contact": 4, "lone_sample": 1}

    def test_a_payload_that_cannot_be_decoded(self, tmp_path, plant, grid_10, ingest_path):
        from mcap.writer import Writer

        path = tmp_path / "a.mcap"
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            channel = writer.register_channel("/rig", "json", 0)
            for k in range(20):
                payload = b'{"gap_mm": 8, "current_a": 1, "voltage_v": 2}' if k != 5 else b'{"gap_mm": '
                writer.add_message(channel, T0 + k * 10 * MS, payload, T0 + k * 10 * MS)
            writer.finish()
        made = ingest_path(path, signals=None, settings=grid_10, plant=plant)
        assert made.left_out == {"not_decodable": 1}


class TestTopics:
    def test_topics_that_are_not_mapped_are_counted(self, ingest, mcap_files):
        extra = [mcap_files.Msg("/rosout", T0, {"level": 1})] * 7
        _, quarantine, made = ingest(REGULAR, extra=extra)
        assert quarantine[["topic", "code", "count", "message_index"]].to_numpy().tolist() == [
            ["/rosout", "unmapped_topic", 7, -1]
        ]
        assert made.counts["messages"] == 57

    def test_each_point_has_segments_of_its_own(self, ingest, mcap_files):
        extra = [mcap_files.Msg("/suspension/F2/state", T0 + k * 10 * MS, value()) for k in range(8) if k != 3]
        samples, _, made = ingest(REGULAR, extra=extra, using=IngestSettings(grid_ms=10, longest_bridge_ms=15))
        assert samples.groupby(["point", "segment"]).size().to_dict() == {("F1", 0): 50, ("F2", 0): 3, ("F2", 1): 4}
        assert made.facts["points"] == ["F1", "F2"]

    def two_topics(self):
        return SignalMap.model_validate(
            {
                "topic": "/gap/(?P<point>.+)",
                "gap": {"field": "gap_mm", "unit": "mm"},
                "current": {"field": "i", "unit": "A", "topic": "/coil/(?P<point>.+)"},
                "voltage": {"field": "u", "unit": "V", "topic": "/coil/(?P<point>.+)"},
            }
        )

    def test_a_point_is_where_its_topics_overlap(self, ingest, mcap_files):
        coil = [mcap_files.Msg("/coil/F1", T0 + t * MS, {"i": float(t), "u": float(t)}) for t in range(104, 300, 10)]
        gaps = [{"gap_mm": 8.0}] * 50
        samples, quarantine, _ = ingest(REGULAR, values=gaps, topic="/gap/F1", extra=coil, signals=self.two_topics())
        np.testing.assert_array_equal(samples["t"].astype("int64"), T0 + np.arange(110, 300, 10) * MS)
        np.testing.assert_allclose(samples["current_a"], np.arange(110, 300, 10))
        np.testing.assert_array_equal(samples["voltage_v"], np.arange(104, 294, 10))
        assert set(samples["voltage_origin"]) == {"held"}
        # Of the gap, 100 ... 300 ms were needed: the messages about both ends of the overlap are used as well.
        assert found_at(quarantine, "no_partner") == [*range(10), *range(31, 50)]

    def test_after_a_reset_the_topics_meet_again(self, tmp_path, mcap_files, plant, grid_10, ingest_path):
        messages = []
        for _ in range(2):
            for t in range(1000, 1200, 10):
                messages.append(mcap_files.Msg("/gap/F1", T0 + t * MS, {"gap_mm": 8.0}))
                messages.append(mcap_files.Msg("/coil/F1", T0 + t * MS, {"i": 1.0, "u": 1.0}))
        path = mcap_files.write(tmp_path / "a.mcap", messages)
        made = ingest_path(path, signals=self.two_topics(), settings=grid_10, plant=plant)
        assert made.samples.to_pandas().groupby("segment").size().tolist() == [20, 20]
        assert made.left_out == {}

    def test_a_shared_topic_counts_once(self, ingest, mcap_files):
        signals = SignalMap.model_validate(
            {
                "topic": "/suspension/(?P<point>[^/]+)/state",
                "gap": {"field": "gap_mm", "unit": "mm"},
                "current": {"field": "coil_current_a", "unit": "A"},
                "voltage": {"field": "coil_voltage_v", "unit": "V"},
                "context": {"speed_m_s": {"field": "v", "unit": "m/s", "topic": "/vehicle"}},
            }
        )
        extra = [mcap_files.Msg("/suspension/F2/state", T0 + t * MS, value()) for t in REGULAR]
        extra += [mcap_files.Msg("/vehicle", T0 + t * MS, {"v": float(t)}) for t in range(0, 300, 20)]
        samples, quarantine, made = ingest(REGULAR, extra=extra, signals=signals)
        assert samples.groupby("point").size().tolist() == [50, 50]
        np.testing.assert_allclose(samples["speed_m_s"][:29], np.arange(0, 290, 10))
        assert samples["speed_m_s"][29:50].isna().all()
        assert made.counts["messages"] == 115
        assert made.counts["messages_used"] == 115
        assert len(quarantine) == 0


class TestRefusal:
    def test_no_message_at_all(self, tmp_path, mcap_files, plant, grid_10, ingest_path):
        path = mcap_files.write(tmp_path / "a.mcap", [])
        with pytest.raises(LogError, match="the log holds no messages"):
            ingest_path(path, signals=None, settings=grid_10, plant=plant)

    @pytest.mark.parametrize("t_ms", [[0], [0, 10, 1000][:1], [1, 2, 3], [5, 12]])
    def test_fewer_than_two_samples(self, ingest, t_ms):
        with pytest.raises(LogError, match="fewer than two usable samples") as found:
            ingest(t_ms)
        assert "left out" in found.value.what

    def test_the_reasons_are_told(self, ingest):
        with pytest.raises(LogError, match=r"left out: not_finite 50"):
            ingest(REGULAR, np.full(50, np.nan))

    def test_a_wrong_unit_is_told_with_the_one_that_would_fit(self, ingest):
        in_um = np.full(50, 8000.0) + np.arange(50)
        with pytest.raises(LogError, match="left out: contact 50") as found:
            ingest(REGULAR, in_um)
        assert "The unit that would fit is 'um'" in found.value.todo

    def test_no_signal_that_can_be_mapped(self, ingest):
        with pytest.raises(LogError, match="have to be named"):
            ingest(REGULAR, values=[{"temperature": 20.0}] * 50)


@given(
    steps=st.lists(st.integers(-40, 60), min_size=2, max_size=80),
    gaps=st.lists(st.sampled_from([8.0, 9.0, 15.99, 16.0, 0.4, float("nan")]), min_size=80, max_size=80),
    grid_ms=st.sampled_from([1, 7, 10, 100]),
    seed=st.integers(0, 2**31),
)
@settings(max_examples=80, deadline=None)
def test_whatever_comes_every_message_and_every_row_is_accounted_for(
    tmp_path_factory, write_log, plant, steps, gaps, grid_ms, seed, ingest_path
):
    path = tmp_path_factory.mktemp("any") / "a.mcap"
    t_ms = np.cumsum(steps) + 10_000
    write_log(path, t_ms, gaps[: len(steps)], chunk_size=500)
    using = IngestSettings(grid_ms=grid_ms, longest_bridge_ms=1 + seed % 200, reorder_ms=seed % 90)
    try:
        made = ingest_path(path, signals=None, settings=using, plant=plant)
    except LogError:
        with pytest.raises(LogError, match="fewer than two usable samples"):
            ingest_path(path, signals=None, settings=using, plant=plant)
        return
    samples, quarantine = made.samples.to_pandas(), made.quarantine.to_pandas()
    messages = quarantine[quarantine["level"] == "message"]
    rows = quarantine[quarantine["level"] == "sample"]
    assert made.counts["messages"] == len(steps) == made.counts["messages_used"] + messages["count"].sum()
    assert made.counts["grid_rows"] == len(samples) + rows["count"].sum()
    assert not messages["message_index"].duplicated().any()
    assert np.isfinite(samples[["gap_m", "gap_velocity_m_s", "current_a", "voltage_v"]].to_numpy()).all()
    grid_ns = grid_ms * MS
    for _, segment in samples.groupby("segment"):
        assert len(segment) >= 2
        assert (np.diff(segment["t"].astype("int64")) == grid_ns).all()
        assert segment["step"].tolist() == list(range(len(segment)))
        assert not segment["contact"].iloc[:-1].any()
    assert sorted(set(samples["segment"])) == list(range(samples["segment"].max() + 1))


@pytest.mark.parametrize(
    ("name", "rows"), [("step_json", 2989), ("multistep_json", 3487), ("constant_ros2", 2989), ("sine_protobuf", 2884)]
)
def test_recorded_logs(levitador, name, rows, ingest_path):
    signals = SignalMap.model_validate(
        {
            "topic": "/levitator/state",
            "gap": {"field": "y", "unit": "m"},
            "current": {"field": "i", "unit": "A"},
            "voltage": {"field": "u", "unit": "V"},
            "set_point": {"field": "yd", "unit": "m"},
        }
    )
    ball = Plant(mass_kg=0.018, resistance_ohm=2.72, set_point_m=0.005, gap_min_m=0.0005, gap_max_m=0.0195)
    made = ingest_path(levitador / f"{name}.mcap", signals=signals, settings=IngestSettings(grid_ms=10), plant=ball)
    samples = made.samples.to_pandas()
    assert made.counts["messages_used"] == rows == made.counts["grid_rows"]
    assert len(samples) + made.left_out.get("contact", 0) + made.left_out.get("lone_sample", 0) == rows
    assert set(samples["gap_origin"]) == {"measured"}
    assert set(samples["gap_velocity_origin"]) == {"reconstructed"}
    free = samples[~samples["contact"]]
    assert 0.0005 < free["gap_m"].min() < free["gap_m"].max() < 0.0195
    assert made.facts["topics"]["/levitator/state"]["period_ms"] == 10.0
    assert not made.facts["simulated"]
