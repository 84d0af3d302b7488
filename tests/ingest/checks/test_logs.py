"""On whole logs: every planted defect is found at its place and nothing that is not there; real recordings are read."""

import json
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_offline.ingest.checks import CheckSettings, point_findings, recording_findings, signal_findings
from maglev_offline.ingest.points import assemble
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.ingest.topics import clean
from maglev_offline.logs.channels import read_info
from maglev_offline.logs.mapping import resolve
from maglev_offline.logs.reader import read_columns
from maglev_offline.logs.surrogate import generate
from maglev_offline.logs.surrogate_settings import RecorderFaults, SurrogateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.recipe import load_recipe

LOGS = ("constant_ros2", "multistep_json", "sine_protobuf", "step_json")


def check(path, *, signals=None, ingest=None, plant=None):
    """All findings of a log, and the columns of its topics."""
    ingest, plant, settings = ingest or IngestSettings(), plant or Plant(), CheckSettings()
    plan = resolve(signals, read_info(path).channels)
    columns = read_columns(path, {name: topic.paths for name, topic in plan.topics.items()})
    found, topics = [], {}
    for name, topic_plan in plan.topics.items():
        topics[name], entries = clean(columns[name], topic_plan, plan.signal_map, ingest)
        found += recording_findings("a-1", columns[name], topics[name], entries, plan.signal_map, ingest, settings)
        found += signal_findings("a-1", topics[name], topic_plan, plant, settings)
    for point, sources in plan.sources.items():
        found += point_findings("a-1", assemble(point, sources, topics, ingest, plant), plant, settings)
    return SimpleNamespace(found=found, columns=columns)


@pytest.fixture(scope="module")
def surrogates(tmp_path_factory):
    """Two simulated logs, PID and cascade, the second with a reset; every defect is planted often."""
    faults = RecorderFaults(
        late_share=0.01, dropped_share=0.02, repeated_share=0.01, hole_spacing_s=20, clock_reset_log=1,
        clock_reset_at_s=33, clock_reset_back_s=15,
    )  # fmt: skip
    settings = SurrogateSettings(
        logs=2, points=2, duration_s=60, run_s=(9, 11), from_stop_share=0.3, recorder=faults, encodings=("cdr",)
    )
    paths = generate(tmp_path_factory.mktemp("raw"), plant=Plant(), mdp=Mdp(), settings=settings, truth=True)
    return [
        SimpleNamespace(**vars(check(path)), defects=json.loads(path.with_suffix(".defects.json").read_text()))
        for path in paths
    ]


@pytest.fixture(params=[0, 1], ids=["pid", "cascade"])
def log(request, surrogates):
    """Each of the logs in turn."""
    return surrogates[request.param]


def places_of(log, code, topic):
    return [place for f in log.found if f.code == code and f.topic == topic for place in f.places]


class TestSurrogates:
    def test_late_and_repeated_messages_are_those_that_were_planted(self, log):
        for topic, columns in log.columns.items():
            for code, planted in (("late_messages", "late"), ("repeated_messages", "repeated")):
                seen = [
                    int(columns.sequence[k])
                    for place in places_of(log, code, topic)
                    for k in range(place.first_message, place.last_message + 1)
                ]
                assert sorted(seen) == sorted(d["sequence"] for d in log.defects[planted] if d["topic"] == topic)

    def test_dropped_messages_are_those_that_were_planted(self, log):
        for topic, columns in log.columns.items():
            seen = {
                number
                for place in places_of(log, "dropped_messages", topic)
                for number in range(columns.sequence[place.first_message] + 1, columns.sequence[place.last_message])
            }
            planted = {d["sequence"] for d in log.defects["dropped"] if d["topic"] == topic}
            # The first and the last messages of a topic, and those beside a hole, leave no gap of their own.
            for number in planted - seen:
                held = columns.sequence[columns.sequence < number], columns.sequence[columns.sequence > number]
                assert min(map(len, held)) == 0 or held[1].min() - held[0].max() > 6
            assert seen <= planted

    def test_every_hole_is_found_and_every_silence_has_a_cause(self, log):
        back = (log.defects["clock_reset"] or {}).get("back_ns", 0)
        at = (log.defects["clock_reset"] or {}).get("true_time_ns", np.iinfo(np.int64).max)

        def stamp(true_ns):
            return true_ns - back * (true_ns >= at)

        runs = log.defects["runs"]
        holes = [(stamp(h["start_ns"]), stamp(h["end_ns"])) for h in log.defects["holes"]]
        pauses = [(stamp(a["end_ns"]), stamp(b["start_ns"])) for a, b in pairwise(runs)]
        dropped = [d["publish_time_ns"] for d in log.defects["dropped"]]
        for topic in log.columns:
            silent = [(p.start_ns, p.end_ns) for code in ("hole", "pause") for p in places_of(log, code, topic)]
            for start, end in holes:
                # A hole that a pause swallows, or that holds the reset, is seen as that.
                swallowed = any(a <= end and start <= b for a, b in pauses) or end < start
                assert swallowed or any(a <= start and end <= b + 2e8 for a, b in silent)
            for a, b in silent:
                causes = [*holes, *pauses]
                assert any(a <= end and start <= b for start, end in causes) or sum(a < d < b for d in dropped) >= 2

    def test_the_reset_is_found_where_it_is(self, log):
        for topic, columns in log.columns.items():
            resets = places_of(log, "clock_reset", topic)
            assert len(resets) == (log.defects["clock_reset"] is not None)
            for place in resets:
                at = log.defects["clock_reset"]["true_time_ns"]
                assert columns.publish_time_ns[place.last_message] < at
                assert 0 <= at - columns.publish_time_ns[: place.first_message + 1].max() < 3e9

    def test_nothing_else_is_said_of_recording_and_signals(self, log):
        true = {"late_messages", "repeated_messages", "dropped_messages", "hole", "pause", "clock_reset", "jitter",
                "saturated"}  # fmt: skip
        assert {f.code for f in log.found if f.about != "use"} <= true
        assert {f.code for f in log.found if f.about == "use"} <= {"contact", "coarse_time_base", "action_variance"}

    def test_the_time_base_is_told_of_every_point(self, log):
        assert [f.point for f in log.found if f.code == "coarse_time_base"] == ["P1", "P2"]

    def test_a_pid_leaves_little_of_the_action_to_anything_but_the_state(self, surrogates):
        left = [f.numbers["share_left"] for f in surrogates[0].found if f.code == "action_variance"]
        assert len(left) == 2
        assert max(left) < 0.1


@pytest.mark.parametrize("name", LOGS)
def test_the_levitators_recordings_are_told_for_what_they_are(levitador, pipelines, name):
    recipe = load_recipe(pipelines / "levitator.toml")
    found = check(levitador / f"{name}.mcap", signals=recipe.signals, ingest=recipe.ingest, plant=recipe.plant).found
    quanta = {f.numbers["signal"]: f.numbers["quantum"] for f in found if f.code == "quantised"}
    assert quanta == {"gap": pytest.approx(49e-6, rel=0.02), "current": pytest.approx(2.2e-3, rel=0.02)}
    extremes = [f.numbers["extreme"] for f in found if f.code == "saturated" and f.numbers["signal"] == "voltage"]
    assert extremes == [0, 9.86]
    by_code = {f.code: f for f in found}
    assert by_code["contact"].numbers["share"] > (0.2 if name == "sine_protobuf" else 0.002)
    numbers = by_code["voltage_mismatch"].numbers
    assert numbers["declared_ohm"] == 2.72
    assert 13 < numbers["low_ohm"] < numbers["resistance_ohm"] < numbers["high_ohm"] < 18
    # The stamps are perfectly regular: nothing is wrong with how they were recorded.
    assert [f.code for f in found if f.about == "recording"] == []
