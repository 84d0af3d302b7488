"""Surrogate logs: they say what they are, agree with the truth, and hold each planted defect at its place."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2

from maglev_offline.logs.surrogate import METADATA_NAME, epoch_ns, generate, log_name
from maglev_offline.logs.surrogate_recorder import STATE_MESSAGE
from maglev_offline.logs.surrogate_settings import RecorderFaults, SurrogateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

COMMITTED = Path(__file__).parents[2] / "data_raw"
FIELDS = list(STATE_MESSAGE.units)
BAD = RecorderFaults(
    late_share=0.05,
    dropped_share=0.05,
    repeated_share=0.05,
    hole_spacing_s=4.0,
    hole_s=(0.5, 1.0),
    clock_reset_log=2,
    clock_reset_at_s=6.0,
    clock_reset_back_s=5.0,
)
SETTINGS = SurrogateSettings(duration_s=9.0, points=2, run_s=(3.0, 4.0), recorder=BAD, seed=5)


class Made(NamedTuple):
    frame: pd.DataFrame
    metadata: dict[str, str]
    truth: pd.DataFrame
    defects: dict[str, Any]


def read(path: Path) -> tuple[pd.DataFrame, dict[str, str]]:
    """All messages in the order of the file, and the metadata record."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[Protobuf(), Ros2()])
        rows = []
        if path.stem.endswith("json"):
            for _, channel, m in reader.iter_messages(log_time_order=False):
                value = json.loads(m.data)
                assert list(value) == FIELDS
                rows.append([channel.topic, m.sequence, m.log_time, m.publish_time, *value.values()])
        else:
            for _, channel, m, value in reader.iter_decoded_messages(log_time_order=False):
                values = [getattr(value, name) for name in FIELDS]
                rows.append([channel.topic, m.sequence, m.log_time, m.publish_time, *values])
        (record,) = reader.iter_metadata()
    assert record.name == METADATA_NAME
    return pd.DataFrame(rows, columns=["topic", "sequence", "log_time", "publish_time", *FIELDS]), record.metadata


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("surrogate")
    generate(path, plant=Plant(), mdp=Mdp(), settings=SETTINGS, truth=True)
    return path


@pytest.fixture(params=range(3))
def made(folder: Path, request: pytest.FixtureRequest) -> Made:
    path = folder / f"{log_name(SETTINGS, request.param)}.mcap"
    frame, metadata = read(path)
    truth = pd.read_parquet(path.with_suffix(".truth.parquet"))
    return Made(frame, metadata, truth, json.loads(path.with_suffix(".defects.json").read_text()))


def true_time(made: Made) -> pd.Series:
    """Sensor time in true time: stamps after the reset come later in the file than those before it."""
    reset, stamps = made.defects["clock_reset"], made.frame.publish_time
    if reset is None:
        return stamps
    jump = np.flatnonzero(np.diff(made.frame.log_time) < -1_000_000_000)
    assert len(jump) == 1
    return stamps + np.where(np.arange(len(stamps)) > jump[0], reset["back_ns"], 0)


def test_says_that_it_is_simulated(made: Made) -> None:
    assert made.metadata["simulated"] == "true"
    assert "no recording" in made.metadata["note"]
    assert SurrogateSettings.model_validate_json(made.metadata["settings"]) == SETTINGS
    assert made.metadata["seed"] == "5"


def test_agrees_with_the_truth_within_sensor_noise(made: Made) -> None:
    truth = made.truth.assign(t=made.truth.t.astype("int64"), topic="/suspension/" + made.truth.point + "/state")
    both = made.frame.assign(t=true_time(made)).merge(truth, on=["t", "topic"], how="left", validate="many_to_one")
    assert both.gap_m.notna().all()
    for seen, true, factor, std in (
        ("gap_mm", "gap_m", 1e3, 0.005),
        ("coil_current_a", "current_a", 1, 0.02),
        ("coil_voltage_v", "voltage_v", 1, 0.05),
        ("set_point_mm", "set_point_m", 1e3, 0.0006),
        ("gap_velocity_mm_s", "gap_velocity_m_s", 1e3, 3.0),
    ):
        off = both[seen] - factor * both[true]
        assert np.abs(off).max() < 6 * std, seen
        assert off.std() < 1.3 * std, seen


def test_defects_are_where_they_are_said(made: Made) -> None:
    frame, defects = made.frame, made.defects
    keys = list(zip(frame.topic, frame.sequence, frame.publish_time, strict=True))
    count = pd.Series(keys).value_counts().to_dict()

    def listed(kind: str) -> list[tuple[str, int, int]]:
        return [(d["topic"], d["sequence"], d["publish_time_ns"]) for d in defects[kind]]

    assert defects["late"]
    assert defects["dropped"]
    assert defects["repeated"]
    assert not set(listed("dropped")) & set(keys)
    assert {key for key, n in count.items() if n == 2} == set(listed("repeated"))
    delay = frame.log_time - frame.publish_time
    across_reset = delay < 0  # sent before the jump of the clock, received after it
    assert {keys[k] for k in np.flatnonzero((delay > 100_000_000) & ~across_reset)} <= set(listed("late"))
    assert len(defects["late"]) - (delay > 100_000_000).sum() <= across_reset.sum()
    t = true_time(made)
    assert defects["holes"]
    for hole in defects["holes"]:
        assert not ((t >= hole["start_ns"]) & (t < hole["end_ns"])).any()
    in_a_run = np.zeros(len(t), dtype=bool)
    for run in defects["runs"]:
        in_a_run |= (t >= run["start_ns"]) & (t < run["end_ns"])
    assert in_a_run.all()


def test_messages_lie_in_the_order_of_their_arrival(made: Made) -> None:
    jumps = np.flatnonzero(np.diff(made.frame.log_time) < 0)
    assert len(jumps) == (made.defects["clock_reset"] is not None)


def test_same_bytes_again(folder: Path, tmp_path: Path) -> None:
    for path in generate(tmp_path, plant=Plant(), mdp=Mdp(), settings=SETTINGS):
        assert path.read_bytes() == (folder / path.name).read_bytes()
    assert len(list(tmp_path.iterdir())) == SETTINGS.logs


@pytest.mark.parametrize("log", range(3))
def test_committed_logs(log: int, beginning: Path) -> None:
    """The logs of data_raw are what the generator makes: the beginning of each is made anew and compared."""
    name = f"{log_name(SurrogateSettings(), log)}.mcap"
    committed, metadata = read(COMMITTED / name)
    assert metadata["simulated"] == "true"
    assert SurrogateSettings.model_validate_json(metadata["settings"]) == SurrogateSettings()
    again, _ = read(beginning / name)
    start = epoch_ns(log)
    committed, again = (x[(x.log_time >= start) & (x.log_time < start + 4 * 10**9)] for x in (committed, again))
    assert len(again) > 100
    stamps = ["topic", "sequence", "log_time", "publish_time"]
    assert committed[stamps].reset_index(drop=True).equals(again[stamps].reset_index(drop=True))
    # one quantum of tolerance: the last digit of a sine differs between machines
    np.testing.assert_allclose(committed[FIELDS], again[FIELDS], atol=0.11)


@pytest.fixture(scope="module")
def beginning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("beginning")
    generate(path, plant=Plant(), mdp=Mdp(), settings=SurrogateSettings(duration_s=5.0))
    return path


def test_committed_set_is_small_and_varied() -> None:
    logs = sorted(COMMITTED.glob("*.mcap"))
    assert sum(path.stat().st_size for path in logs) < 4_500_000
    assert len(logs) == 3
    assert {path.stem.split("-")[2] for path in logs} == {"pid", "cascade"}
    total = 0
    for path in logs:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        total += summary.statistics.message_count
    assert total > 50_000
