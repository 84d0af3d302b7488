"""The ingest stage: many logs to one artefact of samples each."""

import re
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import joblib

from maglev_offline.errors import ArtefactError, LogError
from maglev_offline.ingest import samples
from maglev_offline.ingest.ledger import RULE_VERSION
from maglev_offline.ingest.log import ingest_log
from maglev_offline.ingest.samples import load_samples
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.records import open_log
from maglev_offline.logs.signals import SignalMap
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress
from maglev_offline.tables import write_parquet
from maglev_offline.workspace import Manifest, Workspace, fingerprint, sha256_of

__all__ = ["KIND", "IngestResult", "LogOutcome", "ingest_logs", "load_samples", "log_id_of", "samples_made_with"]

KIND = "samples"
"""The kind of artefact, and its folder in the workspace."""

Status = Literal["ingested", "skipped", "refused", "duplicate"]


@dataclass(frozen=True)
class LogOutcome:
    """What became of one log; `message` is the paragraph for a user, `folder` the artefact (None if refused).

    `counts` and `left_out` are those of the manifest, empty for a refused log and for a duplicate.
    """

    path: Path
    log_id: str
    status: Status
    counts: dict[str, int]
    left_out: dict[str, int]
    message: str
    folder: Path | None


@dataclass(frozen=True)
class IngestResult:
    """What became of each log, in order of their names."""

    logs: tuple[LogOutcome, ...]

    @property
    def folders(self) -> tuple[Path, ...]:
        """The artefacts of these logs, each once; what the next stage reads."""
        return tuple(dict.fromkeys(log.folder for log in self.logs if log.folder is not None))

    @property
    def refused(self) -> tuple[LogOutcome, ...]:
        """The logs that could not be used."""
        return tuple(log for log in self.logs if log.status == "refused")


def samples_made_with(
    workspace: Workspace, *, signals: SignalMap | None, settings: IngestSettings, plant: Plant
) -> tuple[list[Path], list[Path]]:
    """Folders of the samples that these settings made, and of those that others made and that do not go with them."""
    wanted = _tables(signals, settings, plant)
    folders = workspace.list(KIND)
    fits = [Manifest.read(folder).settings == wanted for folder in folders]
    return (
        [folder for folder, fit in zip(folders, fits, strict=True) if fit],
        [folder for folder, fit in zip(folders, fits, strict=True) if not fit],
    )


def _tables(signals: SignalMap | None, settings: IngestSettings, plant: Plant) -> dict[str, object]:
    return {
        "ingest": settings.model_dump(mode="json"),
        "plant": plant.model_dump(mode="json"),
        "signals": signals.model_dump(mode="json") if signals is not None else None,
    }


def log_id_of(path: Path, sha256: str) -> str:
    """Name of a log in every artefact: the file's stem, made safe for a file name, and a piece of its hash."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", path.stem).lstrip(".-") or "log"
    return f"{stem}-{sha256[:8]}"


def ingest_logs(
    paths: Iterable[Path],
    workspace: Workspace,
    *,
    signals: SignalMap | None,
    settings: IngestSettings,
    plant: Plant,
    jobs: int = 1,
    progress: Progress = SILENT,
) -> IngestResult:
    """Turn every log into the artefact `samples/<log_id>`; one that is there already, unchanged, is skipped.

    A log that cannot be used is refused with its reason and the others are ingested. A log whose content came under
    another name already, in `paths` or in the workspace, is a duplicate and is not ingested twice. The order of
    `paths` and the number of `jobs` (logs side by side) change nothing. The caller holds the workspace's lock.
    """
    ordered = sorted(dict.fromkeys(Path(p) for p in paths), key=lambda p: (p.name, str(p)))
    outcomes: dict[Path, LogOutcome] = {}
    tasks: list[_Task] = []
    first_of: dict[str, _Task] = {}
    copies: list[tuple[Path, _Task]] = []
    for path in ordered:
        try:
            with open_log(path):
                sha256 = sha256_of(path)
        except LogError as error:
            outcomes[path] = _refused(path, error)
            continue
        if sha256 in first_of:
            copies.append((path, first_of[sha256]))
            continue
        mark = fingerprint(
            KIND,
            {"log": sha256},
            settings,
            plant,
            signals=signals.model_dump(mode="json") if signals is not None else None,
            rule_version=RULE_VERSION,
        )
        task = _Task(path, log_id_of(path, sha256), sha256, mark)
        first_of[sha256] = task
        folder = workspace.path(KIND, task.log_id)
        if workspace.is_current(folder, mark):
            manifest = Manifest.read(folder)
            outcomes[path] = _done(task, folder, manifest, "skipped", "is there already, unchanged.")
        elif (stored := _stored_copy(workspace, task)) is not None:
            text = f"{path.name}: the same content is there already as {stored.name}; it was not ingested again."
            outcomes[path] = LogOutcome(path, task.log_id, "duplicate", {}, {}, text, stored)
        else:
            tasks.append(task)

    with progress.task("ingest", len(tasks), "log") as tick:
        work = joblib.Parallel(n_jobs=jobs, return_as="generator")(
            joblib.delayed(_ingest_one)(task, workspace, signals, settings, plant) for task in tasks
        )
        for outcome in work:
            outcomes[outcome.path] = outcome
            (progress.error if outcome.status == "refused" else progress.say)(outcome.message)
            tick(1)
    for path, task in copies:
        original = outcomes[task.path]
        text = f"{path.name}: the same content as {task.path.name}; it was not ingested twice."
        outcomes[path] = replace(
            original, path=path, status="duplicate", counts={}, left_out={}, message=text, folder=original.folder
        )
    for path in ordered:
        if outcomes[path].status in ("skipped", "duplicate"):
            progress.say(outcomes[path].message)
        elif outcomes[path].status == "refused" and path not in {task.path for task in tasks}:
            progress.error(outcomes[path].message)
    return IngestResult(tuple(outcomes[path] for path in ordered))


@dataclass(frozen=True)
class _Task:
    path: Path
    log_id: str
    sha256: str
    mark: str


def _ingest_one(
    task: _Task, workspace: Workspace, signals: SignalMap | None, settings: IngestSettings, plant: Plant
) -> LogOutcome:
    try:
        made = ingest_log(task.path, task.log_id, signals=signals, settings=settings, plant=plant)
    except LogError as error:
        return _refused(task.path, error, task.log_id)
    folder = workspace.path(KIND, task.log_id)
    manifest = Manifest(
        artefact=KIND,
        fingerprint=task.mark,
        inputs={"log": task.sha256},
        counts=made.counts,
        left_out=made.left_out,
        facts={"log_id": task.log_id, "file": task.path.name, "sha256": task.sha256, **made.facts},
        settings=_tables(signals, settings, plant),
    )
    with workspace.commit(folder, manifest) as draft:
        write_parquet(made.samples, draft / samples.SAMPLES)
        write_parquet(made.quarantine, draft / samples.QUARANTINE)
    # What other settings made of the same content under another name is superseded: left in place, the next stage
    # would read the log twice.
    for copy in _copies(workspace, task):
        shutil.rmtree(copy)
    counts = made.counts
    text = (
        f"{counts['messages_used']:,} of {counts['messages']:,} messages became {counts['rows']:,} samples of "
        f"{counts['points']} point{'s' * (counts['points'] != 1)} in {counts['segments']:,} "
        f"segment{'s' * (counts['segments'] != 1)}."
    )
    period_ms = min(
        (topic["period_ms"] for topic in made.facts["topics"].values() if topic["period_ms"]), default=settings.grid_ms
    )
    if period_ms < settings.grid_ms / 1.5:
        text += f" The messages come every {period_ms:g} ms: [ingest] grid_ms = {settings.grid_ms:g} thins them out."
    return _done(task, folder, manifest, "ingested", text)


def _done(task: _Task, folder: Path, manifest: Manifest, status: Status, text: str) -> LogOutcome:
    return LogOutcome(
        task.path,
        task.log_id,
        status,
        dict(manifest.counts),
        dict(manifest.left_out),
        f"{task.path.name}: {text}",
        folder,
    )


def _refused(path: Path, error: LogError, log_id: str = "") -> LogOutcome:
    return LogOutcome(path, log_id or path.stem, "refused", {}, {}, error.paragraph(), None)


def _copies(workspace: Workspace, task: _Task) -> Iterator[Path]:
    """Artefacts of the same content under other names."""
    for folder in workspace.list(KIND):
        if folder.name.endswith(f"-{task.sha256[:8]}") and folder.name != task.log_id:
            try:
                if Manifest.read(folder).inputs.get("log") == task.sha256:
                    yield folder
            except ArtefactError:  # it will be found by whoever reads it
                continue


def _stored_copy(workspace: Workspace, task: _Task) -> Path | None:
    """Artefact of the same content under another name, made by the same settings."""
    return next((folder for folder in _copies(workspace, task) if workspace.is_current(folder, task.mark)), None)
