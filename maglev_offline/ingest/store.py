"""The ingest stage: many logs to one artefact of samples each."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from maglev_offline.errors import ArtefactError, InputError, LogError
from maglev_offline.filesystems import Where, name_of
from maglev_offline.hashes import Stamp, stamp_of
from maglev_offline.ingest.known_logs import hash_of_log
from maglev_offline.ingest.log_outcome import IngestResult, LogOutcome, Status, refused, sentence
from maglev_offline.ingest.log_task import KIND, LogTask, log_id_of, refuse_changed, tasks_of
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.samples import load_samples
from maglev_offline.logs.source import open_source
from maglev_offline.progress import SILENT, Progress
from maglev_offline.workspace import Manifest, Workspace

__all__ = ["KIND", "IngestResult", "LogOutcome", "ingest_logs", "load_samples", "log_id_of", "samples_made_with"]

LARGE_BYTES = 64 * 2**20
"""Larger logs are ingested one after the other, the processes sharing each; smaller ones side by side."""


def samples_made_with(workspace: Workspace, request: Request) -> tuple[list[Path], list[Path]]:
    """Folders of the samples that these settings made, and of those that others made and that do not go with them."""
    wanted = _meaning(request.tables())
    folders = workspace.list(KIND)
    fits = [_meaning(workspace.manifest(folder).settings) == wanted for folder in folders]
    return (
        [folder for folder, fit in zip(folders, fits, strict=True) if fit],
        [folder for folder, fit in zip(folders, fits, strict=True) if not fit],
    )


def _meaning(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The tables that say what a row means; which rows were selected, and what was checked, makes no other rows."""
    return {name: table for name, table in tables.items() if name not in ("select", "checks")}


def ingest_logs(
    logs: Iterable[Where],
    workspace: Workspace,
    request: Request,
    *,
    jobs: int = 1,
    merge: bool = False,
    progress: Progress = SILENT,
) -> IngestResult:
    """Turn every log into the artefact `samples/<log_id>`; one that is there already, unchanged, is skipped.

    A log that cannot be used is refused with its reason and the others are ingested. A log whose content came under
    another name already, in `logs` or in the workspace, is a duplicate and is not ingested twice. With `merge` all of
    them are parts of one recording. The order of `logs` and the number of `jobs` change nothing. The caller holds the
    workspace's lock.

    Raises
    ------
    InputError: with `merge`, a part cannot be read or two parts overlap.
    """
    ordered = sorted(dict.fromkeys(logs), key=lambda where: (name_of(where), str(where)))
    outcomes: dict[Where, LogOutcome] = {}
    hashes: dict[Where, str] = {}
    stamps: dict[Where, Stamp] = {}
    for where in ordered:
        try:
            if isinstance(where, Path):
                with suppress(OSError):  # the hash will say what is wrong
                    stamps[where] = stamp_of(where)
            hashes[where] = hash_of_log(where, workspace.known)
        except LogError as error:
            if merge:
                raise
            outcomes[where] = refused(where, error)
    workspace.known.save()
    tasks: list[LogTask] = []
    first_of: dict[str, LogTask] = {}
    copies: list[tuple[Where, LogTask]] = []
    for task in tasks_of(hashes, stamps, request, merge=merge):
        if task.sha256 in first_of:
            copies.append((task.where, first_of[task.sha256]))
            continue
        first_of[task.sha256] = task
        folder = workspace.path(KIND, task.log_id)
        if (manifest := workspace.current(folder, task.mark)) is not None:
            outcomes[task.where] = _done(task, folder, manifest, "skipped", "is there already, unchanged.")
        elif (stored := _stored_copy(workspace, task)) is not None:
            text = f"{task.name}: the same content is there already as {stored.name}; it was not ingested again."
            outcomes[task.where] = LogOutcome(task.where, task.log_id, "duplicate", {}, {}, text, stored)
        else:
            tasks.append(task)

    before = set(outcomes)
    for outcome in _work(tasks, workspace, request, jobs, progress):
        outcomes[outcome.path] = outcome
        (progress.error if outcome.status == "refused" else progress.say)(outcome.message)
    for where, task in copies:
        text = f"{name_of(where)}: the same content as {task.name}; it was not ingested twice."
        original = outcomes[task.where]
        outcomes[where] = replace(original, path=where, status="duplicate", counts={}, left_out={}, message=text)
    _tell_unchanged(
        [outcomes[where] for where in ordered if where in before or where in {w for w, _ in copies}], progress
    )
    return IngestResult(tuple(outcomes[where] for where in ordered if where in outcomes))


def dry_run(
    logs: Iterable[Where], request: Request, *, jobs: int = 1, merge: bool = False, progress: Progress = SILENT
) -> IngestResult:
    """Go through logs as `ingest_logs` would, and keep nothing."""
    from maglev_offline.ingest.log import ingest_log

    ordered = sorted(dict.fromkeys(logs), key=lambda where: (name_of(where), str(where)))
    outcomes: list[LogOutcome] = []
    for parts in [tuple(ordered)] if merge else [(where,) for where in ordered]:
        name = " + ".join(name_of(part) for part in parts)
        try:
            made = ingest_log(parts, name, request, jobs=jobs, progress=progress)
        except InputError as error:
            outcomes.append(refused(parts[0], error))
            progress.error(outcomes[-1].message)
            continue
        left_out = ", ".join(f"{code} {count:,}" for code, count in made.left_out.items()) or "nothing"
        text = f"{name}: {sentence(made, request)} Left out: {left_out}."
        outcomes.append(LogOutcome(parts[0], name, "not written", made.counts, made.left_out, text, None))
        progress.say(text)
    return IngestResult(tuple(outcomes))


def _tell_unchanged(outcomes: Sequence[LogOutcome], progress: Progress) -> None:
    skipped = [outcome for outcome in outcomes if outcome.status == "skipped"]
    for outcome in outcomes:
        if outcome.status == "refused":
            progress.error(outcome.message)
        elif outcome.status == "duplicate" or len(skipped) <= _MOST_LINES:
            progress.say(outcome.message)
    if len(skipped) > _MOST_LINES:
        progress.say(f"{len(skipped):,} logs are there already, unchanged.")


_MOST_LINES = 20
"""More logs that are there already are told in one line."""


def _work(
    tasks: Sequence[LogTask], workspace: Workspace, request: Request, jobs: int, progress: Progress
) -> Iterator[LogOutcome]:
    """Small logs side by side, large ones one after the other, whose parts are shared; on a cluster a log is one task,
    since what its parts share would go over the network."""
    from maglev_offline.spread import on_cluster, spread

    elsewhere = on_cluster()
    small: list[LogTask] = []
    large: list[LogTask] = []
    for task in tasks:
        alone = not elsewhere and (len(tasks) == 1 or any(is_large(part) for part in task.parts))
        (large if alone else small).append(task)
    with progress.task("ingest", len(tasks), "logs") as tick:
        done = spread(_ingest_one, ((task, workspace, request) for task in small), jobs)
        try:
            for task, outcome in zip(small, done, strict=True):
                if elsewhere and outcome.folder is not None:
                    workspace.wait_for(outcome.folder, task.mark)
                tick(1)
                yield outcome
        finally:  # also where the cluster gave a task up, whose workers were lost
            if elsewhere:
                workspace.tidy(KIND)
        for task in large:
            outcome = _ingest_one(task, workspace, request, jobs, progress)
            tick(1)
            yield outcome


def is_large(where: Where) -> bool:
    """Whether a log is worth sharing among processes; False for one that cannot be read."""
    try:
        with open_source(where) as source:
            return source.size > LARGE_BYTES
    except LogError:
        return False


def _ingest_one(
    task: LogTask, workspace: Workspace, request: Request, jobs: int = 1, progress: Progress = SILENT
) -> LogOutcome:
    from maglev_offline.ingest.log import ingest_log

    folder = workspace.path(KIND, task.log_id)
    manifest = Manifest(
        artefact=KIND,
        fingerprint=task.mark,
        inputs={"log": task.sha256},
        settings=request.tables(),
    )
    try:
        with workspace.commit(folder, manifest) as draft:
            made = ingest_log(task.parts, task.log_id, request, draft, jobs=jobs, progress=progress)
            refuse_changed(task)
            manifest.counts, manifest.left_out = made.counts, made.left_out
            known = {"log_id": task.log_id, "file": task.name, "sha256": task.sha256}
            manifest.facts = {**known, **made.facts}
    except InputError as error:
        return refused(task.where, error, task.log_id)
    # What other settings made of the same content under another name is superseded: left in place, the next stage
    # would read the log twice.
    for copy in _copies(workspace, task):
        shutil.rmtree(copy)
    return _done(task, folder, manifest, "ingested", sentence(made, request))


def _done(task: LogTask, folder: Path, manifest: Manifest, status: Status, text: str) -> LogOutcome:
    counts, left_out = dict(manifest.counts), dict(manifest.left_out)
    return LogOutcome(task.where, task.log_id, status, counts, left_out, f"{task.name}: {text}", folder)


def _copies(workspace: Workspace, task: LogTask) -> Iterator[Path]:
    """Artefacts of the same content under other names."""
    for folder in workspace.path(KIND).glob(f"*-{task.sha256[:8]}"):
        if folder.name != task.log_id:
            try:
                if Manifest.read(folder).inputs.get("log") == task.sha256:
                    yield folder
            except ArtefactError:  # it will be found by whoever reads it
                continue


def _stored_copy(workspace: Workspace, task: LogTask) -> Path | None:
    """Artefact of the same content under another name, made by the same settings."""
    return next((folder for folder in _copies(workspace, task) if workspace.is_current(folder, task.mark)), None)
