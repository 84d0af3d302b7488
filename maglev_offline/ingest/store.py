"""The ingest stage: many logs to one artefact of samples each."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from maglev_offline.errors import ArtefactError, InputError, LogError
from maglev_offline.filesystems import Where, name_of
from maglev_offline.hashes import Stamp, stamp_of
from maglev_offline.ingest.known_logs import hash_of_log
from maglev_offline.ingest.merge import merged_sha256
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.samples import load_samples
from maglev_offline.logs.source import open_source
from maglev_offline.progress import SILENT, Progress
from maglev_offline.workspace import Manifest, Workspace

if TYPE_CHECKING:  # decoding is imported by those logs that are decoded
    from maglev_offline.ingest.log import IngestedLog

__all__ = ["KIND", "IngestResult", "LogOutcome", "ingest_logs", "load_samples", "log_id_of", "samples_made_with"]

KIND = "samples"
"""The kind of artefact, and its folder in the workspace."""

LARGE_BYTES = 64 * 2**20
"""Larger logs are ingested one after the other, the processes sharing each; smaller ones side by side."""

Status = Literal["ingested", "skipped", "refused", "duplicate", "not written"]


@dataclass(frozen=True)
class LogOutcome:
    """What became of one log; `message` is the paragraph for a user, `folder` the artefact (None if refused).

    `counts` and `left_out` are those of the manifest, empty for a refused log and for a duplicate.
    """

    path: Where
    log_id: str
    status: Status
    counts: dict[str, int]
    left_out: dict[str, int]
    message: str
    folder: Path | None

    @property
    def name(self) -> str:
        """File name, for people."""
        return name_of(self.path)


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


def log_id_of(where: Where, sha256: str) -> str:
    """Name of a log in every artefact: the file's stem, made safe for a file name, and a piece of its hash."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name_of(where).removesuffix(".mcap")).lstrip(".-") or "log"
    return f"{stem[:80]}-{sha256[:8]}"


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
            outcomes[where] = _refused(where, error)
    workspace.known.save()
    tasks: list[_Task] = []
    first_of: dict[str, _Task] = {}
    copies: list[tuple[Where, _Task]] = []
    for task in _tasks(hashes, stamps, request, merge=merge):
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
            outcomes.append(_refused(parts[0], error))
            progress.error(outcomes[-1].message)
            continue
        left_out = ", ".join(f"{code} {count:,}" for code, count in made.left_out.items()) or "nothing"
        text = f"{name}: {_sentence(made, request)} Left out: {left_out}."
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


@dataclass(frozen=True)
class _Task:
    """One artefact to make; `parts` are its files (one, but for a merged recording).

    `stamps` are those of the local ones before they were hashed.
    """

    parts: tuple[Where, ...]
    log_id: str
    sha256: str
    mark: str
    stamps: tuple[tuple[Path, Stamp], ...] = ()

    @property
    def where(self) -> Where:
        return self.parts[0]

    @property
    def name(self) -> str:
        return " + ".join(name_of(part) for part in self.parts)


def _tasks(
    hashes: dict[Where, str], stamps: Mapping[Where, Stamp], request: Request, *, merge: bool
) -> Iterator[_Task]:
    groups = [tuple(hashes)] if merge and hashes else [(where,) for where in hashes]
    for parts in groups:
        sha256 = hashes[parts[0]] if len(parts) == 1 else merged_sha256(hashes[part] for part in parts)
        before = tuple((part, stamps[part]) for part in parts if isinstance(part, Path) and part in stamps)
        yield _Task(parts, log_id_of(parts[0], sha256), sha256, request.fingerprint(KIND, sha256), before)


def _work(
    tasks: Sequence[_Task], workspace: Workspace, request: Request, jobs: int, progress: Progress
) -> Iterator[LogOutcome]:
    """Small logs side by side, large ones one after the other, whose parts are shared; on a cluster a log is one task,
    since what its parts share would go over the network."""
    from maglev_offline.spread import on_cluster, spread

    elsewhere = on_cluster()
    small: list[_Task] = []
    large: list[_Task] = []
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
    task: _Task, workspace: Workspace, request: Request, jobs: int = 1, progress: Progress = SILENT
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
            _refuse_changed(task)
            manifest.counts, manifest.left_out = made.counts, made.left_out
            known = {"log_id": task.log_id, "file": task.name, "sha256": task.sha256}
            manifest.facts = {**known, **made.facts}
    except InputError as error:
        return _refused(task.where, error, task.log_id)
    # What other settings made of the same content under another name is superseded: left in place, the next stage
    # would read the log twice.
    for copy in _copies(workspace, task):
        shutil.rmtree(copy)
    return _done(task, folder, manifest, "ingested", _sentence(made, request))


def _refuse_changed(task: _Task) -> None:
    """Raise LogError where a local log is not the file any more that was hashed: its samples would lie under a hash
    that is not theirs."""
    for path, before in task.stamps:
        try:
            same = stamp_of(path) == before
        except OSError:
            same = False
        if not same:
            raise LogError(
                "the log was changed or removed while it was read.",
                where=str(path),
                todo="Wait until the recorder is done with it, and run again.",
            )


def _sentence(made: IngestedLog, request: Request) -> str:
    counts = made.counts
    text = (
        f"{counts['messages_used']:,} of {counts['messages']:,} messages became {counts['rows']:,} samples of "
        f"{counts['points']} point{'s' * (counts['points'] != 1)} in {counts['segments']:,} "
        f"segment{'s' * (counts['segments'] != 1)}."
    )
    told = made.facts["findings"]
    if told["error"] or told["warning"]:
        text += f" {told['error']} errors and {told['warning']} warnings: see `maglev-offline inspect`."
    grid_ms = request.settings.grid_ms
    period_ms = min(
        (topic["period_ms"] for topic in made.facts["topics"].values() if topic["period_ms"]), default=grid_ms
    )
    if period_ms < grid_ms / 1.5:
        text += f" The messages come every {period_ms:g} ms: [ingest] grid_ms = {grid_ms:g} thins them out."
    return text


def _done(task: _Task, folder: Path, manifest: Manifest, status: Status, text: str) -> LogOutcome:
    counts, left_out = dict(manifest.counts), dict(manifest.left_out)
    return LogOutcome(task.where, task.log_id, status, counts, left_out, f"{task.name}: {text}", folder)


def _refused(where: Where, error: InputError, log_id: str = "") -> LogOutcome:
    return LogOutcome(where, log_id or name_of(where).removesuffix(".mcap"), "refused", {}, {}, error.paragraph(), None)


def _copies(workspace: Workspace, task: _Task) -> Iterator[Path]:
    """Artefacts of the same content under other names."""
    for folder in workspace.path(KIND).glob(f"*-{task.sha256[:8]}"):
        if folder.name != task.log_id:
            try:
                if Manifest.read(folder).inputs.get("log") == task.sha256:
                    yield folder
            except ArtefactError:  # it will be found by whoever reads it
                continue


def _stored_copy(workspace: Workspace, task: _Task) -> Path | None:
    """Artefact of the same content under another name, made by the same settings."""
    return next((folder for folder in _copies(workspace, task) if workspace.is_current(folder, task.mark)), None)
