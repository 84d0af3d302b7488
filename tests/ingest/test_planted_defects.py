"""A look at a log finds every planted defect at its place, and no other."""

import json
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from maglev_offline.ingest.inspect import inspect_log
from maglev_offline.ingest.inspect_many import inspect_logs
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs import surrogate
from maglev_offline.logs.surrogate import generate
from maglev_offline.logs.surrogate_settings import RecorderFaults, SurrogateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.recipe import load_recipe

ROOT = Path(__file__).parents[2]
BUNDLED = ("surrogate-01-pid-json", "surrogate-02-cascade-cdr", "surrogate-03-pid-protobuf")
RECORDED = ("constant_ros2", "multistep_json", "sine_protobuf", "step_json")

P1, P2 = "/suspension/P1/state", "/suspension/P2/state"
PERFECT = RecorderFaults(
    late_share=0, dropped_share=0, repeated_share=0, hole_spacing_s=1e6, clock_reset_log=None, jitter_std_ms=0,
    latency_ms=0.1,
)  # fmt: skip
DRIVE = SurrogateSettings(
    logs=1, points=2, duration_s=12, message_period_ms=10, run_s=(20, 20), from_stop_share=0, recorder=PERFECT, seed=7
)
"""Messages come so fast that the plant cannot jump between two of them, and nothing is wrong with the record."""
REQUEST = Request(settings=IngestSettings(grid_ms=10))


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    """Plant `[surrogate.defects]` in the record of one drive, which is simulated once, and look at the log."""
    simulate, drives = surrogate.simulate_log, {}

    def simulate_once(plant, mdp, settings, log, controller):
        if log not in drives:
            drives[log] = simulate(plant, mdp, settings, log, controller)
        return drives[log]

    def make(encoding="cdr", **defects):
        settings = SurrogateSettings.model_validate({**DRIVE.model_dump(), "encodings": [encoding], "defects": defects})
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(surrogate, "simulate_log", simulate_once)
            (path,) = generate(tmp_path_factory.mktemp("log"), plant=Plant(), mdp=Mdp(), settings=settings, truth=True)
        told = json.loads(path.with_suffix(".defects.json").read_text())["planted"]
        return SimpleNamespace(path=path, found=inspect_log(path, REQUEST).findings, planted=told)

    return make


def only(log, code):
    """The one finding of this code."""
    (finding,) = [one for one in log.found if one.code == code]
    return finding


def wrong(log):
    """Topic and code of all findings that say that something is wrong with the record or a signal."""
    return {(one.topic, one.code) for one in log.found if one.about != "use"}


def stretch(place):
    """First and last publish time of a planted stretch."""
    return place["first"]["publish_time_ns"], place["last"]["publish_time_ns"]


def stretches(finding):
    return [(place.start_ns, place.end_ns) for place in finding.places]


def times(places):
    return sorted(place["publish_time_ns"] for place in places)


class TestOneDefect:
    """Each kind alone at one point of two: the finding is there, at the place of the file of defects, and alone."""

    def test_nothing_is_found_where_nothing_is_planted(self, planted):
        assert wrong(planted()) == set()

    @pytest.mark.parametrize("signal", ["gap", "current"])
    def test_a_sensor_that_is_stuck(self, planted, signal):
        log = planted(stuck=[{"signal": signal, "point": 1, "start_s": 3, "duration_s": 2}])
        (place,) = log.planted[0]["places"]
        finding = only(log, "stuck")
        assert (finding.numbers["signal"], finding.numbers["longest_messages"]) == (signal, place["messages"])
        assert stretches(finding) == [stretch(place)]
        assert wrong(log) == {(P2, "stuck")}

    def test_a_signal_that_is_no_number(self, planted):
        log = planted(not_a_number=[{"start_s": 3, "duration_s": 1}])
        (place,) = log.planted[0]["places"]
        finding = only(log, "not_finite")
        assert (finding.numbers["signal"], finding.count) == ("current", place["messages"])
        assert stretches(finding) == [stretch(place)]
        assert wrong(log) == {(P1, "not_finite")}

    @pytest.mark.parametrize("entry", [{"signal": "gap", "size": 4}, {"signal": "current", "size": -6}])
    def test_spikes(self, planted, entry):
        log = planted(spikes=[{**entry, "start_s": 2, "duration_s": 8, "count": 5}])
        finding = only(log, "spikes")
        assert (finding.numbers["signal"], finding.count) == (entry["signal"], 5)
        assert [place.start_ns for place in finding.places] == times(log.planted[0]["places"])
        assert wrong(log) == {(P1, "spikes")}

    def test_a_gap_in_metres_where_millimetres_are_declared(self, planted):
        log = planted(wrong_unit=[{}])
        finding = only(log, "unit_suspect")
        told = {name: finding.numbers[name] for name in ("signal", "declared", "suggested")}
        assert told == {"signal": "gap", "declared": "mm", "suggested": "m"}
        assert wrong(log) == {(P1, "unit_suspect")}

    def test_a_converter_of_few_bits(self, planted):
        log = planted(coarse=[{"quantum": 0.05}])
        finding = only(log, "quantised")
        assert finding.numbers["quantum"] == pytest.approx(50e-6, rel=1e-6)
        assert stretches(finding) == [stretch(log.planted[0]["places"][0])]
        assert wrong(log) == {(P1, "quantised")}

    def test_a_converter_of_so_few_bits_that_the_gap_rests_on_one_level(self, planted):
        assert wrong(planted(coarse=[{"quantum": 0.25}])) == {(P1, "quantised")}

    def test_a_sensor_that_ends_within_its_signals_range(self, planted):
        log = planted(saturated=[{"low": 0, "high": 26.5}])
        ends = {f.numbers["limit"]: f for f in log.found if f.code == "saturated"}
        assert {name: finding.numbers["extreme"] for name, finding in ends.items()} == {"lower": 0, "upper": 26.5}
        inside = [
            {p["publish_time_ns"] for p in log.planted[0]["places"] if a <= p["publish_time_ns"] <= b}
            for finding in ends.values()
            for a, b in stretches(finding)
        ]
        assert sorted(set().union(*inside)) == times(log.planted[0]["places"])
        # A reading may be at the end by itself, next to those that were cut off.
        assert 0 <= sum(f.numbers["messages"] for f in ends.values()) - len(log.planted[0]["places"]) <= 2
        assert wrong(log) == {(P1, "saturated")}

    def test_a_clock_that_runs_fast(self, planted):
        log = planted(clock_drift=[{"clock": "log", "ppm": 400, "point": 1}])
        assert only(log, "clock_drift").numbers["drift_ppm"] == pytest.approx(400, rel=0.02)
        assert wrong(log) == {(P2, "clock_drift")}

    def test_a_clock_that_runs_so_fast_that_it_overtakes_the_recorder(self, planted):
        log = planted(clock_drift=[{"clock": "publish", "ppm": 500}])
        assert only(log, "clock_drift").numbers["drift_ppm"] == pytest.approx(-500, rel=0.02)
        assert wrong(log) == {(P1, "clock_drift"), (P1, "logged_before_published")}

    def test_a_clock_that_stands(self, planted):
        log = planted(frozen_clock=[{"start_s": 4, "duration_s": 1}])
        (place,) = log.planted[0]["places"]
        finding = only(log, "clock_frozen")
        assert finding.numbers["largest_messages"] == place["messages"]
        first, last = place["first"]["sequence"], place["last"]["sequence"]
        assert [(p.first_message, p.last_message) for p in finding.places] == [(first, last)]
        # What follows from it lies there too: the messages of one time, and the time in which there are none.
        assert wrong(log) == {(P1, "clock_frozen"), (P1, "time_conflict"), (P1, "pause")}
        conflict, pause = only(log, "time_conflict").places, only(log, "pause").places
        assert [(p.first_message, p.last_message) for p in conflict] == [(first + 1, last)]
        assert [(p.first_message, p.last_message) for p in pause] == [(last, last + 1)]

    def test_two_recordings_glued_together(self, planted):
        log = planted(seam=[{"at_s": 5, "skip_s": 4, "gap_step_m": 0.002}])
        (defect,) = log.planted
        seams = {one.topic: stretches(one) for one in log.found if one.code == "seam"}
        before, after = ({p["topic"]: p["publish_time_ns"] for p in defect[name]} for name in ("last_before", "places"))
        assert seams == {topic: [(before[topic], after[topic])] for topic in (P1, P2)}
        assert wrong(log) == {(P1, "seam"), (P2, "seam")}

    def test_a_block_that_comes_again(self, planted):
        log = planted(duplicated_block=[{"start_s": 1, "duration_s": 3, "again_s": 6}])
        (defect,) = log.planted
        many = inspect_logs([log.path], REQUEST)
        (finding,) = many.across
        assert (finding.code, finding.point, finding.about) == ("overlapping_content", "P1", "recording")
        assert finding.numbers["share"] == pytest.approx(0.25, abs=0.01)
        told = [stretch(defect[name][0]) for name in ("original", "places")]
        # Content is compared in blocks: a few rows at either end of a stretch may be left out.
        for found, true in zip(sorted(stretches(finding)), told, strict=True):
            assert 0 <= found[0] - true[0] <= 0.4e9
            assert 0 <= true[1] - found[1] <= 0.4e9
        assert wrong(log) == set()

    def test_two_messages_of_one_time(self, planted):
        log = planted(time_conflicts=[{"start_s": 1, "duration_s": 9, "count": 3}])
        finding = only(log, "time_conflict")
        assert [place.start_ns for place in finding.places] == times(log.planted[0]["places"])
        assert finding.count == 3
        assert wrong(log) == {(P1, "time_conflict")}

    def test_another_coil_than_the_declared_one(self, planted):
        log = planted(resistance=[{"extra_ohm": 0.36, "point": 1}])
        finding = only(log, "voltage_mismatch")
        assert finding.point == "P2"
        assert finding.numbers["resistance_ohm"] == pytest.approx(Plant().resistance_ohm + 0.36, rel=0.02)
        assert wrong(log) == set()


@pytest.mark.parametrize("encoding", ["json", "cdr", "protobuf"])
def test_several_defects_in_one_log_in_any_encoding(planted, encoding):
    log = planted(
        encoding,
        stuck=[{"signal": "gap", "point": 1, "start_s": 3, "duration_s": 2}],
        spikes=[{"signal": "current", "point": 1, "start_s": 6, "duration_s": 4, "size": 6}],
        not_a_number=[{"signal": "voltage", "point": 0, "start_s": 8, "duration_s": 1}],
        coarse=[{"signal": "current", "point": 0, "quantum": 0.1}],
        clock_drift=[{"clock": "log", "ppm": 400, "point": 0}],
    )
    assert wrong(log) == {
        (P2, "stuck"), (P2, "spikes"), (P1, "not_finite"), (P1, "quantised"), (P1, "clock_drift"),
    }  # fmt: skip
    for code in ("stuck", "not_finite"):
        kind = {"not_finite": "not_a_number"}.get(code, code)
        (defect,) = [one for one in log.planted if one["defect"] == kind]
        assert stretches(only(log, code)) == [stretch(place) for place in defect["places"]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A log with all of the recorder's faults, and a clock that is set back."""
    faults = RecorderFaults(
        late_share=0.01, dropped_share=0.02, repeated_share=0.01, hole_spacing_s=12, clock_reset_log=0,
        clock_reset_at_s=19, clock_reset_back_s=15,
    )  # fmt: skip
    settings = SurrogateSettings(
        logs=1, points=2, duration_s=40, run_s=(9, 11), from_stop_share=1, recorder=faults, encodings=("protobuf",)
    )
    (path,) = generate(tmp_path_factory.mktemp("raw"), plant=Plant(), mdp=Mdp(), settings=settings, truth=True)
    return SimpleNamespace(
        found=inspect_log(path, Request()).findings,
        defects=json.loads(path.with_suffix(".defects.json").read_text()),
        truth=pd.read_parquet(path.with_suffix(".truth.parquet")),
    )


class TestTheRecordersFaults:
    """A reset is in these logs: a stamp may stand for two true times, so causes are told in the log's stamps."""

    def places(self, recorded, *codes):
        return [(f.topic, place) for f in recorded.found if f.code in codes for place in f.places]

    @pytest.mark.parametrize(("code", "kind"), [("late_messages", "late"), ("repeated_messages", "repeated")])
    def test_late_and_repeated_messages(self, recorded, code, kind):
        seen = sorted((topic, place.start_ns) for topic, place in self.places(recorded, code))
        told = sorted((one["topic"], one["publish_time_ns"]) for one in recorded.defects[kind])
        assert seen == told
        assert len(told) > 2

    def test_dropped_messages(self, recorded):
        told = [(one["topic"], one["publish_time_ns"]) for one in recorded.defects["dropped"]]
        missing = sum(f.numbers["missing"] for f in recorded.found if f.code == "dropped_messages")
        assert len(told) - 4 <= missing <= len(told)  # the last before a silence leaves no gap of its own
        for topic, place in self.places(recorded, "dropped_messages"):
            if place.start_ns < place.end_ns:  # and not the reset in between
                assert any(one == topic and place.start_ns < t < place.end_ns for one, t in told)

    def test_every_silence_is_a_planted_hole_or_a_planned_pause(self, recorded):
        reset = recorded.defects["clock_reset"]

        def stamp(true_ns):
            return true_ns - reset["back_ns"] * (true_ns >= reset["true_time_ns"])

        holes = [(stamp(one["start_ns"]), stamp(one["end_ns"])) for one in recorded.defects["holes"]]
        pauses = [(stamp(a["end_ns"]), stamp(b["start_ns"])) for a, b in pairwise(recorded.defects["runs"])]
        for topic in (P1, P2):
            silent = [(p.start_ns, p.end_ns) for one, p in self.places(recorded, "hole", "pause") if one == topic]
            for a, b in silent:
                assert any(start < b and a < end for start, end in [*holes, *pauses])
            for start, end in [cause for cause in [*holes, *pauses] if cause[0] < cause[1]]:
                assert any(start < b and a < end for a, b in silent)

    def test_the_clock_that_was_set_back(self, recorded):
        resets = self.places(recorded, "clock_reset")
        assert [topic for topic, _ in resets] == [P1, P2]
        at, back = (recorded.defects["clock_reset"][name] for name in ("true_time_ns", "back_ns"))
        for _, place in resets:
            assert 0 <= at - place.start_ns < 3e9
            assert 0 <= place.end_ns - (at - back) < 3e9

    def test_contact_is_where_the_true_gap_is_at_a_stop(self, recorded):
        plant, truth = Plant(), recorded.truth
        at, back = (recorded.defects["clock_reset"][name] for name in ("true_time_ns", "back_ns"))
        t_ns = truth["t"].astype("int64").to_numpy()
        stamp = np.where(t_ns >= at, t_ns - back, t_ns)
        found = [f for f in recorded.found if f.code == "contact"]
        assert [f.point for f in found] == ["P1", "P2"]
        for finding in found:
            mine = (truth["point"] == finding.point).to_numpy()
            gap = truth["gap_m"].to_numpy()
            for place in finding.places:
                near = mine & (stamp >= place.start_ns - 1e8) & (stamp <= place.end_ns + 1e8)
                slack = 3e-5  # of the sensor's noise
                assert (gap[near].min() < plant.gap_min_m + slack) or (gap[near].max() > plant.gap_max_m - slack)

    def test_there_is_nothing_else(self, recorded):
        told = {f.code for f in recorded.found if f.about != "use"}
        assert told == {
            "late_messages", "repeated_messages", "dropped_messages", "hole", "pause", "clock_reset", "jitter",
        }  # fmt: skip


@pytest.mark.parametrize("name", BUNDLED)
def test_in_the_bundled_logs_are_the_recorders_faults_and_no_others(name):
    found = inspect_log(ROOT / f"data_raw/{name}.mcap", Request()).findings
    planted = {"late_messages", "repeated_messages", "dropped_messages", "hole", "pause", "jitter"}
    if name == BUNDLED[1]:  # in the second log the clocks jump back by 45 s
        planted.add("clock_reset")
        back = [f.numbers["largest_back_s"] for f in found if f.code == "clock_reset"]
        assert back == pytest.approx([45.0] * 4, abs=0.5)
    assert {f.code for f in found if f.about != "use"} == planted
    for code in planted:
        assert len({f.topic for f in found if f.code == code}) == 4
    assert {f.code for f in found if f.about == "use"} <= {"contact", "coarse_time_base", "action_variance"}


@pytest.mark.parametrize("name", RECORDED)
def test_the_recordings_of_a_levitator_are_told_for_what_they_are(levitador, name):
    request = load_recipe(ROOT / "pipelines/levitator.toml").request
    found = inspect_log(levitador / f"{name}.mcap", request).findings
    assert {"quantised", "saturated", "contact", "voltage_mismatch"} <= {f.code for f in found}
    assert {f.code for f in found if f.about == "recording"} == set()
