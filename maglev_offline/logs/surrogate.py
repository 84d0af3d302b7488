"""Surrogate logs: MCAP files of simulated runs that look like logs of real controllers, and say that they are not."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from maglev_offline import __version__
from maglev_offline.logs.surrogate_defect_settings import PlantedDefects
from maglev_offline.logs.surrogate_plant import RunTruth, load_kg, simulate_log
from maglev_offline.logs.surrogate_record import MS
from maglev_offline.logs.surrogate_recorder import STATE_MESSAGE, Defects, record, topic_of
from maglev_offline.logs.surrogate_settings import ControllerKind, SurrogateSettings
from maglev_offline.logs.writer import Encoding, write_log
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress

METADATA_NAME = "maglev-offline surrogate"

_FIRST_LOG_NS = 1_704_096_000 * 10**9  # 2024-01-01 08:00 UTC
_DAY_NS = 86_400 * 10**9


def kinds_of(settings: SurrogateSettings, log: int) -> tuple[ControllerKind, Encoding]:
    """Controller and encoding of a log, counted from 0."""
    return settings.controllers[log % len(settings.controllers)], settings.encodings[log % len(settings.encodings)]


def epoch_ns(log: int) -> int:
    """True time at which a log begins, ns since the epoch."""
    return _FIRST_LOG_NS + log * _DAY_NS


def log_name(settings: SurrogateSettings, log: int) -> str:
    """File name of a log without its ending, such as `surrogate-01-pid-json`."""
    return "-".join(("surrogate", f"{log + 1:02d}", *kinds_of(settings, log)))


def generate(
    output: Path,
    *,
    plant: Plant,
    mdp: Mdp,
    settings: SurrogateSettings,
    truth: bool = False,
    progress: Progress = SILENT,
) -> list[Path]:
    """Write the logs into `output` and return their paths; the same arguments give the same bytes.

    `truth` adds, for checks only, `<log>.truth.parquet` (1 kHz, without noise) and `<log>.defects.json` (what was
    planted where). Every file appears under its name only when it is whole.
    """
    output.mkdir(parents=True, exist_ok=True)
    paths = []
    with progress.task("surrogate logs", settings.logs, "logs") as tick:
        for log in range(settings.logs):
            controller, encoding = kinds_of(settings, log)
            truths = simulate_log(plant, mdp, settings, log, controller)
            load = load_kg(plant, settings, log)
            messages, defects = record(truths, settings, log, load, epoch_ns(log))
            path = output / f"{log_name(settings, log)}.mcap"
            write_log(
                path,
                [topic_of(point) for point in range(settings.points)],
                STATE_MESSAGE,
                messages,
                encoding=encoding,
                metadata={METADATA_NAME: _metadata(plant, mdp, settings, log)},
            )
            if truth:
                _write_truth(path.with_suffix(".truth.parquet"), truths, epoch_ns(log))
                _write_defects(path.with_suffix(".defects.json"), defects)
            progress.say(f"{path.name}: {len(messages.topic)} messages, {controller}, {encoding}, {load:g} kg")
            paths.append(path)
            tick(1)
    return paths


def _metadata(plant: Plant, mdp: Mdp, settings: SurrogateSettings, log: int) -> dict[str, str]:
    controller, _ = kinds_of(settings, log)
    # Without defects the record is what it was before there were any to plant, byte for byte.
    unused = {"defects"} if settings.defects == PlantedDefects() else None
    return {
        "simulated": "true",
        "note": "These are simulated data, made by maglev-offline; they are no recording of any real vehicle.",
        "seed": str(settings.seed),
        "log": str(log),
        "controller": controller,
        "settings": settings.model_dump_json(exclude=unused),
        "plant": plant.model_dump_json(),
        "voltage_limit_v": repr(mdp.voltage_limit_v),
        "start_gap_m": json.dumps(mdp.start_gap_m),
        "maglev_offline_version": __version__,
    }


def _write_truth(path: Path, truths: list[RunTruth], start_ns: int) -> None:
    """One row for a millisecond of a point: t in true time, whatever the log's clock did."""
    draft = path.with_name(f".{path.name}.draft")
    try:
        tables = []
        for truth in truths:
            steps, points = truth.gap_m.shape
            t = start_ns + (round(truth.run.start_s * 1e3) + np.arange(steps)) * MS
            columns = {
                "gap_m": truth.gap_m,
                "gap_velocity_m_s": truth.velocity_m_s,
                "current_a": truth.current_a,
                "voltage_v": truth.voltage_v,
                "set_point_m": truth.set_point_m,
                "force_n": truth.force_n,
            }
            stamps = pa.array(np.repeat(t, points), pa.int64()).cast(pa.timestamp("ns", tz="UTC"))
            names = pa.array([f"P{point + 1}" for point in range(points)] * steps)
            tables.append(pa.table({"t": stamps, "point": names, **{k: x.ravel() for k, x in columns.items()}}))
        pq.write_table(pa.concat_tables(tables), draft, compression="zstd")
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def _write_defects(path: Path, defects: Defects) -> None:
    draft = path.with_name(f".{path.name}.draft")
    try:
        draft.write_text(json.dumps(vars(defects), indent=1) + "\n")
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
