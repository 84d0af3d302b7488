"""Defects planted in surrogate logs: none by default, and each is in the file where it is told, and nowhere else."""

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2
from pydantic import ValidationError

from maglev_offline.logs import surrogate
from maglev_offline.logs.surrogate import epoch_ns, generate, log_name
from maglev_offline.logs.surrogate_recorder import STATE_MESSAGE
from maglev_offline.logs.surrogate_settings import RecorderFaults, SurrogateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

COMMITTED = Path(__file__).parents[2] / "data_raw"
FIELDS = list(STATE_MESSAGE.units)
S = 10**9
QUIET = RecorderFaults(
    late_share=0,
    dropped_share=0,
    repeated_share=0,
    hole_spacing_s=1e6,
    clock_reset_log=None,
    jitter_std_ms=0.5,
    latency_ms=0.5,
)
CLEAN = SurrogateSettings(
    logs=1, points=2, duration_s=12.0, message_period_ms=20, run_s=(20.0, 20.0), recorder=QUIET, seed=7
)
P1, P2 = "/suspension/P1/state", "/suspension/P2/state"

Log = tuple[pd.DataFrame, dict[str, str], dict[str, Any]]
Make = Callable[..., Log]


class JsonDecoders:
    def decoder_for(self, message_encoding: str, schema: object) -> Callable[[bytes], dict[str, float]] | None:
        return json.loads if message_encoding == "json" else None


def read(path: Path) -> Log:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[Protobuf(), Ros2(), JsonDecoders()])
        rows = [
            [
                c.topic,
                m.sequence,
                m.log_time,
                m.publish_time,
                *(v[f] if isinstance(v, dict) else getattr(v, f) for f in FIELDS),
            ]
            for _, c, m, v in reader.iter_decoded_messages(log_time_order=False)
        ]
        (record,) = reader.iter_metadata()
    frame = pd.DataFrame(rows, columns=["topic", "sequence", "log_time", "publish_time", *FIELDS])
    return frame, record.metadata, json.loads(path.with_suffix(".defects.json").read_text())


@pytest.fixture(scope="module")
def one_drive() -> Iterator[None]:
    """Simulate the drive once: defects are in the record of it only."""
    with pytest.MonkeyPatch.context() as patch:
        drives: dict[str, Any] = {}
        simulate = surrogate.simulate_log

        def simulate_once(plant: Plant, mdp: Mdp, settings: SurrogateSettings, *others: Any) -> Any:
            key = repr((plant, mdp, settings.duration_s, settings.points, settings.seed, others))
            if key not in drives:
                drives[key] = simulate(plant, mdp, settings, *others)
            return drives[key]

        patch.setattr(surrogate, "simulate_log", simulate_once)
        yield


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory, one_drive: None) -> Make:
    """Make a log with these `[surrogate.defects]`: its messages, metadata and list of defects."""

    def make(base: SurrogateSettings = CLEAN, **defects: list[dict[str, Any]]) -> Log:
        folder = tmp_path_factory.mktemp("log")
        made = SurrogateSettings.model_validate({**base.model_dump(), "defects": defects})
        (path, *_) = generate(folder, plant=Plant(), mdp=Mdp(), settings=made, truth=True)
        return read(path)

    return make


@pytest.fixture(scope="module")
def clean(make: Make) -> pd.DataFrame:
    return make()[0]


def changed(frame: pd.DataFrame, clean: pd.DataFrame) -> dict[str, np.ndarray]:
    """The columns that differ, and in which rows."""
    assert len(frame) == len(clean)
    differs = {
        name: np.flatnonzero(~((frame[name] == clean[name]) | (frame[name].isna() & clean[name].isna())))
        for name in frame.columns
    }
    return {name: rows for name, rows in differs.items() if len(rows)}


def in_stretch(frame: pd.DataFrame, topic: str, start_s: float, duration_s: float) -> np.ndarray:
    t = frame.publish_time - epoch_ns(0)
    inside = (frame.topic == topic) & (t >= start_s * S) & (t < (start_s + duration_s) * S)
    return np.flatnonzero(inside)


def message(frame: pd.DataFrame, row: int) -> dict[str, int]:
    found = frame.iloc[row]
    return {
        "sequence": int(found.sequence),
        "publish_time_ns": int(found.publish_time),
        "log_time_ns": int(found.log_time),
    }


def assert_span(place: dict[str, Any], frame: pd.DataFrame, rows: np.ndarray) -> None:
    """The place is the stretch of these rows, which are in the order of their sequence."""
    rows = rows[np.argsort(frame.sequence.iloc[rows], kind="stable")]
    assert place["messages"] == len(rows) > 0
    assert place["topic"] == frame.topic.iloc[rows[0]]
    assert place["first"] == message(frame, rows[0])
    assert place["last"] == message(frame, rows[-1])


def assert_each(places: list[dict[str, Any]], frame: pd.DataFrame, rows: np.ndarray) -> None:
    assert places == [{"topic": frame.topic.iloc[k], **message(frame, k)} for k in rows]


def only(defects: dict[str, Any], kind: str) -> dict[str, Any]:
    (planted,) = defects["planted"]
    assert planted["defect"] == kind
    return planted


def test_by_default_nothing_is_planted_and_the_metadata_do_not_speak_of_it(make: Make, clean: pd.DataFrame) -> None:
    _, metadata, defects = make()
    assert defects["planted"] == []
    assert "defects" not in json.loads(metadata["settings"])
    assert SurrogateSettings.model_validate_json(metadata["settings"]) == CLEAN


def test_default_logs_are_what_they_were(tmp_path: Path) -> None:
    """The stamps of the first 3 s of the default logs, as they were before there were defects to plant.

    Values are compared with the committed logs elsewhere: their last digit differs between machines.
    """
    before = [
        "b995e20904d42b5562ce733033d2e25f2a0cede35ffd262034e428a100bd5a03",
        "205a5f89e345610d42529b286e3c12470a506c963d00fe8cee8cfb1f836c0271",
        "7f790a61e0e754b899e153283679c61e6279bfb643c11ec0699a52eb707c5491",
    ]
    paths = generate(tmp_path, plant=Plant(), mdp=Mdp(), settings=SurrogateSettings(duration_s=3.0), truth=True)
    for path, digest in zip(paths, before, strict=True):
        frame, *_ = read(path)
        stamps = frame[["topic", "sequence", "log_time", "publish_time"]].to_numpy().tolist()
        assert hashlib.sha256(json.dumps(stamps).encode()).hexdigest() == digest


@pytest.mark.parametrize("log", range(3))
def test_the_metadata_of_the_committed_logs_are_those_of_today(log: int) -> None:
    with (COMMITTED / f"{log_name(SurrogateSettings(), log)}.mcap").open("rb") as file:
        (record,) = make_reader(file).iter_metadata()
    assert record.metadata["settings"] == SurrogateSettings().model_dump_json(exclude={"defects"})


def test_stuck_sensor(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(stuck=[{"signal": "gap", "start_s": 4, "duration_s": 1.5, "point": 1}])
    rows = in_stretch(frame, P2, 4, 1.5)
    assert frame.gap_mm.iloc[rows].nunique() == 1
    assert frame.gap_mm.iloc[rows[0]] == clean.gap_mm.iloc[rows[0]]
    differing = changed(frame, clean)
    assert list(differing) == ["gap_mm"]
    assert set(differing["gap_mm"]) <= set(rows)
    assert_span(only(defects, "stuck")["places"][0], frame, rows)


def test_not_a_number(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(not_a_number=[{"signal": "current", "start_s": 3, "duration_s": 0.5}])
    rows = in_stretch(frame, P1, 3, 0.5)
    assert frame.coil_current_a.iloc[rows].isna().all()
    assert {name: list(x) for name, x in changed(frame, clean).items()} == {"coil_current_a": list(rows)}
    assert_span(only(defects, "not_a_number")["places"][0], frame, rows)


def test_spikes(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(spikes=[{"signal": "gap", "start_s": 3, "duration_s": 6, "count": 4, "size": 3.0}])
    differing = changed(frame, clean)
    assert list(differing) == ["gap_mm"]
    rows = differing["gap_mm"]
    assert len(rows) == 4
    assert set(rows) <= set(in_stretch(frame, P1, 3, 6))
    np.testing.assert_allclose((frame.gap_mm - clean.gap_mm).iloc[rows], 3.0)
    assert_each(only(defects, "spikes")["places"], frame, rows)


def test_wrong_unit(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(wrong_unit=[{"signal": "gap", "factor": 0.001, "point": None}])
    np.testing.assert_allclose(frame.gap_mm, clean.gap_mm / 1000, rtol=1e-9)
    assert list(changed(frame, clean)) == ["gap_mm"]
    places = only(defects, "wrong_unit")["places"]
    assert [place["topic"] for place in places] == [P1, P2]
    assert_span(places[1], frame, np.flatnonzero(frame.topic == P2))


def test_coarse_quantum(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(coarse=[{"signal": "gap", "quantum": 0.25}])
    rows = np.flatnonzero(frame.topic == P1)
    steps = frame.gap_mm.iloc[rows] / 0.25
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert np.abs(frame.gap_mm - clean.gap_mm).max() <= 0.125 + 1e-9
    assert set(changed(frame, clean)["gap_mm"]) <= set(rows)
    assert_span(only(defects, "coarse")["places"][0], frame, rows)


def test_saturated_sensor(make: Make, clean: pd.DataFrame) -> None:
    low, high = np.quantile(clean.coil_current_a[clean.topic == P1], [0.1, 0.8])
    frame, _, defects = make(saturated=[{"signal": "current", "low": float(low), "high": float(high)}])
    mine = frame.topic == P1
    assert frame.coil_current_a[mine].between(low, high).all()
    rows = np.flatnonzero(mine & ~clean.coil_current_a.between(low, high))
    assert {name: list(x) for name, x in changed(frame, clean).items()} == {"coil_current_a": list(rows)}
    assert_each(only(defects, "saturated")["places"], frame, rows)


@pytest.mark.parametrize(("clock", "column"), [("log", "log_time"), ("publish", "publish_time")])
def test_clock_drift(make: Make, clean: pd.DataFrame, clock: str, column: str) -> None:
    frame, _, defects = make(clock_drift=[{"clock": clock, "ppm": 2000.0}])
    gained = (frame[column] - clean[column])[clean.topic == P1]
    elapsed = (clean[column] - epoch_ns(0))[clean.topic == P1]
    np.testing.assert_allclose(gained, 0.002 * elapsed, atol=1)
    assert list(changed(frame, clean)) == [column]
    assert_span(only(defects, "clock_drift")["places"][0], frame, np.flatnonzero(frame.topic == P1))


def test_frozen_clock(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(frozen_clock=[{"start_s": 5, "duration_s": 2, "clock": "both"}])
    rows = in_stretch(clean, P1, 5, 2)
    assert frame.log_time.iloc[rows].nunique() == frame.publish_time.iloc[rows].nunique() == 1
    differing = changed(frame, clean)
    assert set(differing) == {"log_time", "publish_time"}
    assert set(differing["publish_time"]) < set(rows)
    assert_span(only(defects, "frozen_clock")["places"][0], frame, rows)


def test_seam(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(seam=[{"at_s": 4, "skip_s": 3, "gap_step_m": 0.001}])
    planted = only(defects, "seam")
    for topic in (P1, P2):
        mine, whole = frame[frame.topic == topic], clean[clean.topic == topic]
        restart = np.flatnonzero(np.diff(mine.sequence) < 0)
        assert len(restart) == 1
        before, after = mine.iloc[: restart[0] + 1], mine.iloc[restart[0] + 1 :]
        assert after.sequence.tolist() == list(range(len(after)))
        assert after.publish_time.iloc[0] - before.publish_time.iloc[-1] < 0.06 * S  # no hole shows it
        source = whole[whole.publish_time >= epoch_ns(0) + 7 * S]
        assert after.publish_time.tolist() == (source.publish_time - 3 * S).tolist()
        np.testing.assert_allclose(after.gap_mm, source.gap_mm + 1.0)
        np.testing.assert_allclose(after.coil_current_a, source.coil_current_a)
        assert before[FIELDS].to_numpy().tolist() == whole[FIELDS].iloc[: len(before)].to_numpy().tolist()
        assert {"topic": topic, **message(after, 0)} in planted["places"]
        assert {"topic": topic, **message(before, len(before) - 1)} in planted["last_before"]


def test_duplicated_block(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(duplicated_block=[{"start_s": 2, "duration_s": 3, "again_s": 8}])
    source = in_stretch(clean, P1, 2, 3)
    again = in_stretch(clean, P1, 8, 4)[: len(source)]
    assert frame[FIELDS].iloc[again].to_numpy().tolist() == clean[FIELDS].iloc[source].to_numpy().tolist()
    differing = changed(frame, clean)
    assert not set(differing) & {"topic", "sequence", "log_time", "publish_time"}
    assert set(np.concatenate(list(differing.values()))) <= set(again)
    planted = only(defects, "duplicated_block")
    assert_span(planted["places"][0], frame, again)
    assert_span(planted["original"][0], frame, source)


def test_a_block_that_the_log_does_not_hold_whole_is_cut(make: Make) -> None:
    _, _, defects = make(duplicated_block=[{"start_s": 2, "duration_s": 3, "again_s": 11.5}])
    planted = only(defects, "duplicated_block")
    assert 15 < planted["places"][0]["messages"] == planted["original"][0]["messages"] < 30


def test_time_conflicts(make: Make, clean: pd.DataFrame) -> None:
    frame, _, defects = make(time_conflicts=[{"start_s": 2, "duration_s": 8, "count": 3, "size": 0.5}])
    assert len(frame) == len(clean) + 3
    second = np.flatnonzero(frame.duplicated(["topic", "sequence", "publish_time"]))
    assert_each(only(defects, "time_conflicts")["places"], frame, second)
    both = frame.iloc[second].merge(clean, on=["topic", "sequence", "publish_time"], suffixes=("", "_of_first"))
    np.testing.assert_allclose(both.gap_mm - both.gap_mm_of_first, 0.5)
    assert (both.log_time > both.log_time_of_first).all()
    assert frame.drop(index=second).reset_index(drop=True).equals(clean)


def test_other_resistance(make: Make, clean: pd.DataFrame) -> None:
    """In the mean over a steady drive u = R i, with another R than the metadata tell."""
    frame, metadata, defects = make(resistance=[{"extra_ohm": 0.6}])
    declared = json.loads(metadata["plant"])["resistance_ohm"]
    steady = frame[(frame.topic == P1) & (frame.publish_time > epoch_ns(0) + 4 * S)]
    assert steady.coil_voltage_v.mean() / steady.coil_current_a.mean() == pytest.approx(declared + 0.6, rel=0.02)
    assert list(changed(frame, clean)) == ["coil_voltage_v"]
    assert_span(only(defects, "resistance")["places"][0], frame, np.flatnonzero(frame.topic == P1))


def test_all_at_once_in_a_log_with_the_recorders_faults(make: Make) -> None:
    """Places hold in the stamps of the file after a clock reset too; the other logs have no defect."""
    faults = RecorderFaults(late_share=0.02, dropped_share=0.02, repeated_share=0.02, clock_reset_log=0,
                            clock_reset_at_s=6.0, clock_reset_back_s=3.0, hole_spacing_s=1e6)  # fmt: skip
    base = CLEAN.model_copy(update={"recorder": faults})
    frame, _, defects = make(
        base,
        seam=[{"at_s": 9.0, "skip_s": 0.5}],
        spikes=[{"signal": "gap", "start_s": 7.0, "duration_s": 1.0, "count": 3, "size": 5.0}],
        not_a_number=[{"signal": "voltage", "start_s": 1.0, "duration_s": 0.4, "point": 1}],
        stuck=[{"log": 3, "start_s": 1.0, "duration_s": 1.0}],
    )
    assert [planted["defect"] for planted in defects["planted"]] == ["seam", "spikes", "not_a_number"]
    _, spikes, missing = defects["planted"]
    keys = frame.set_index(["topic", "sequence", "publish_time", "log_time"]).sort_index()
    usual = frame.gap_mm[frame.topic == P1].median()
    for place in spikes["places"]:
        key = (place["topic"], place["sequence"], place["publish_time_ns"], place["log_time_ns"])
        assert keys.loc[[key]].gap_mm.iloc[0] > usual + 3
    (place,) = missing["places"]
    assert frame[frame.coil_voltage_v.isna()].topic.unique().tolist() == [place["topic"]] == [P2]
    assert frame.coil_voltage_v.isna().sum() == place["messages"]


def test_a_repeated_message_stays_one_that_is_repeated(make: Make) -> None:
    """A spike or a copied block never makes a time conflict of it."""
    base = CLEAN.model_copy(update={"recorder": QUIET.model_copy(update={"repeated_share": 0.3})})
    block, spikes = {"start_s": 1, "duration_s": 4, "again_s": 6}, {"start_s": 1, "duration_s": 10, "count": 100}
    frame, _, defects = make(base, duplicated_block=[block], spikes=[spikes])
    assert frame.duplicated(["topic", "sequence", "publish_time"]).sum() > 200
    same_time = frame.groupby(["topic", "sequence", "publish_time"])[FIELDS]
    assert (same_time.nunique() == 1).all(axis=None)
    assert len(defects["planted"][1]["places"]) > 110
    once = frame.drop_duplicates(["topic", "sequence", "publish_time"])
    rows = [in_stretch(once, P1, start_s, 4) for start_s in (1, 6)]
    source, again = (once[FIELDS[2:4]].iloc[x[:150]].to_numpy() for x in rows)  # the spikes are in the gap
    assert again.tolist() == source.tolist()


def test_same_bytes_again_with_defects(tmp_path: Path) -> None:
    defects = {"spikes": [{"start_s": 1, "duration_s": 3}], "time_conflicts": [{"start_s": 1, "duration_s": 3}]}
    settings = SurrogateSettings.model_validate({**CLEAN.model_dump(), "duration_s": 5.0, "defects": defects})
    one, two = (
        generate(tmp_path / name, plant=Plant(), mdp=Mdp(), settings=settings, truth=True)[0] for name in ("a", "b")
    )
    for ending in (".mcap", ".defects.json"):
        assert one.with_suffix(ending).read_bytes() == two.with_suffix(ending).read_bytes()
    assert json.loads(read(one)[1]["settings"])["defects"]["spikes"][0]["count"] == 5


def test_an_unknown_defect_is_refused() -> None:
    with pytest.raises(ValidationError, match="stuk"):
        SurrogateSettings.model_validate({"defects": {"stuk": [{"start_s": 1, "duration_s": 1}]}})
    with pytest.raises(ValidationError, match="duration_s"):
        SurrogateSettings.model_validate({"defects": {"stuck": [{"start_s": 1}]}})
