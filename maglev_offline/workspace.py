"""Where artefacts lie: one folder each, committed whole or not at all, with a manifest of where it came from."""

import fcntl
import hashlib
import json
import os
import secrets
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

from maglev_offline import __version__
from maglev_offline.errors import ArtefactError, InputError, WorkspaceLocked
from maglev_offline.hashes import KnownHashes, Stamp, stamp_of
from maglev_offline.hashes import sha256_of as sha256_of
from maglev_offline.leftovers import draft_and_retired, sweep
from maglev_offline.manifest import SCHEMA
from maglev_offline.manifest import Manifest as Manifest
from maglev_offline.manifest import package_versions as package_versions
from maglev_offline.settings import Settings

LATE_S = 120.0
"""So long a network drive may keep what another machine wrote from this one."""

KNOWN_HASHES = ".known_hashes.json"
"""File of the workspace in which the hashes of logs and artefacts are kept; see `hashes`. It may be removed."""


def fingerprint(stage: str, inputs: Mapping[str, str], *settings: Settings, **options: Any) -> str:
    """Hash of all that an artefact's bytes depend on: the stage, its inputs' hashes, its recipe tables, its options.

    The order of the tables does not matter; no two may be of one kind, since one would hide the other.
    """
    tables = {type(s).__name__: s.model_dump(mode="json") for s in settings}
    if len(tables) < len(settings):
        raise ValueError(f"two recipe tables of one kind in the fingerprint of {stage!r}")
    text = json.dumps(
        {
            "stage": stage,
            "schema": SCHEMA,
            "version": __version__,
            "inputs": dict(inputs),
            "settings": tables,
            "options": options,
        },
        sort_keys=True,
    )
    return hashlib.sha256(text.encode()).hexdigest()


class Workspace:
    """A folder of artefacts. Readers see whole artefacts only; one command writes at a time."""

    def __init__(self, root: Path, *, rehash: bool = False) -> None:
        self.root, self.rehash = root, rehash
        self._manifests: dict[Path, tuple[Stamp, Manifest]] = {}
        self._holder: str | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Go to a worker process without hashes and manifests, which are many and not its business."""
        return {"root": self.root, "rehash": self.rehash, "_manifests": {}, "_holder": self._holder}

    @cached_property
    def known(self) -> KnownHashes:
        """Hashes of files that were not touched since; with `rehash`, every file is read once more."""
        return KnownHashes(self.root / KNOWN_HASHES, distrust=self.rehash)

    def path(self, *parts: str) -> Path:
        """Folder of an artefact, for instance `path("samples", log_id)`."""
        return self.root.joinpath(*parts)

    def manifest(self, folder: Path) -> Manifest:
        """Read the manifest in `folder`, or give the one that was read before if it was not touched since.

        It is shared: whoever changes it changes what others see. Raises ArtefactError as `Manifest.read` does.
        """
        try:
            stamp = stamp_of(folder / "manifest.json")
        except OSError:
            return Manifest.read(folder)
        found = self._manifests.get(folder)
        if found is None or found[0] != stamp:
            found = self._manifests[folder] = (stamp, Manifest.read(folder))
        return found[1]

    def current(self, folder: Path, mark: str) -> Manifest | None:
        """Manifest of the artefact in `folder` if it is whole and was made from what `mark` stands for."""
        try:
            manifest = self.manifest(folder)
        except ArtefactError:
            return None
        whole = manifest.fingerprint == mark and not changed_files(folder, manifest, self.known)
        return manifest if whole else None

    def is_current(self, folder: Path, mark: str) -> bool:
        """Whether the artefact in `folder` is whole and was made from what `mark` stands for."""
        return self.current(folder, mark) is not None

    def wait_for(self, folder: Path, mark: str) -> None:
        """Wait until the artefact that another machine made in `folder` is seen here.

        A network drive tells of it late, up to a minute, but at once where this machine has changed the folder above.

        Raises
        ------
        ArtefactError: it is not seen, or is another one.
        """
        until = time.monotonic() + LATE_S
        while not _has_mark(folder, mark):
            if time.monotonic() > until:
                raise ArtefactError(
                    "another machine made this, and it is not seen here.",
                    where=str(folder),
                    todo="Is the workspace on a drive that shows every machine the same? Give the same command again.",
                )
            nudge = folder.parent / f".{folder.name}.{secrets.token_hex(4)}.draft"
            nudge.touch()
            nudge.unlink(missing_ok=True)
            time.sleep(0.2)

    def tidy(self, kind: str) -> None:
        """Remove what workers left half-written that were lost while others did their work."""
        sweep(self.path(kind))

    def input_hash(self, folder: Path) -> str:
        """Hash that stands for a whole artefact, as `input_hash` of this module; untouched files are not read.

        Raises ArtefactError as that does.
        """
        return _input_hash(folder, self.manifest(folder), self.known)

    def list(self, kind: str) -> list[Path]:
        """Folders of all artefacts of one kind, in order of their names."""
        home = self.path(kind)
        if not home.is_dir():
            return []
        return sorted(p for p in home.iterdir() if (p / "manifest.json").is_file() and not p.name.startswith("."))

    @contextmanager
    def commit(self, folder: Path, manifest: Manifest) -> Iterator[Path]:
        """Give a folder beside `folder` to write into; on leaving, seal it with the manifest and put it in place.

        The body may still fill in `manifest`. If anything fails, nothing is left behind and the old artefact stays.

        Raises
        ------
        WorkspaceLocked: this is a worker that a killed command left behind, and another command holds the workspace.
        """
        self._refuse_orphan()
        folder.parent.mkdir(parents=True, exist_ok=True)
        draft, retired = draft_and_retired(folder)
        draft.mkdir()
        try:
            yield draft
            files = sorted(p for p in draft.rglob("*") if p.is_file())
            manifest.files = {p.relative_to(draft).as_posix(): sha256_of(p) for p in files}
            (draft / "manifest.json").write_text(manifest.sealed())
            for path in (*files, draft / "manifest.json"):
                _sync(path)
            self._refuse_orphan()
            if folder.exists():
                folder.rename(retired)
            draft.rename(folder)
            _sync(folder.parent)
        finally:
            if retired.exists() and not folder.exists():  # stopped between the two renames
                retired.rename(folder)
            for leftover in (draft, retired):
                shutil.rmtree(leftover, ignore_errors=True)

    def holder(self) -> str | None:
        """The command that holds the workspace for writing, and its process; None where nobody does.

        A command that was killed leaves its name behind, but not the lock.
        """
        try:
            with (self.root / ".lock").open() as file:
                found = file.readline().strip()
                if found:
                    fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except (FileNotFoundError, NotADirectoryError):
            return None
        except BlockingIOError:
            return found
        return None

    @contextmanager
    def lock(self, command: str) -> Iterator[None]:
        """Hold the workspace for writing; the second of two commands is told who holds it.

        Raises
        ------
        WorkspaceLocked: another process is at work in this workspace.
        InputError: the workspace cannot be a folder.
        """
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise InputError(
                "this is a file, and a workspace is a folder.", where=str(self.root), todo="Give another --workspace."
            ) from None
        with (self.root / ".lock").open("a+") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                holder = file.readline().strip() or "another command"
                raise WorkspaceLocked(
                    f"the workspace is in use by {holder}.",
                    where=str(self.root),
                    todo="Wait for it to end, or use another --workspace.",
                ) from None
            file.seek(0)
            killed = bool(file.read())  # who held it before was killed, else the file would be empty
            file.truncate(0)
            # The second line tells this holder from any other, of which one may have the same command and number.
            self._holder = f"`maglev-offline {command}` (process {os.getpid()})\n{secrets.token_hex(8)}\n"
            file.write(self._holder)
            file.flush()
            os.fsync(file.fileno())  # else workers on other machines do not see who holds it
            if killed:
                sweep(self.root)
            try:
                yield
            finally:
                self._holder = None
                if "known" in self.__dict__:
                    self.known.save()
                file.truncate(0)

    def _refuse_orphan(self) -> None:
        """Stop a worker whose command was killed, once another command holds the workspace."""
        if self._holder is None:
            return
        try:
            holder = (self.root / ".lock").read_text()
        except OSError:
            return
        if holder != self._holder:
            now = holder.partition("\n")[0] or "nobody"
            raise WorkspaceLocked(f"the workspace has gone over to {now}.", where=str(self.root))


def _has_mark(folder: Path, mark: str) -> bool:
    try:
        return Manifest.read(folder).fingerprint == mark
    except ArtefactError:
        return False


def changed_files(folder: Path, manifest: Manifest, known: KnownHashes | None = None) -> list[str]:
    """Files of an artefact that are gone, or are not what was written; of untouched ones, `known` holds the hash."""
    return [name for name, written in manifest.files.items() if _hash_or_none(folder / name, known) != written]


def _hash_or_none(path: Path, known: KnownHashes | None) -> str | None:
    try:
        return sha256_of(path) if known is None else known.sha256(path)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
        return None


def input_hash(folder: Path) -> str:
    """Hash that stands for a whole artefact: that of its manifest, which holds the hash of each of its files.

    Raises
    ------
    ArtefactError: a file of the artefact is gone, or is not what was written.
    """
    return _input_hash(folder, Manifest.read(folder), None)


def _input_hash(folder: Path, manifest: Manifest, known: KnownHashes | None) -> str:
    changed = changed_files(folder, manifest, known)
    if changed:
        raise ArtefactError(
            f"{', '.join(changed)} {'is' if len(changed) == 1 else 'are'} not what was written there.",
            where=str(folder),
            todo="Remove that folder and run its stage again.",
        )
    path = folder / "manifest.json"
    return sha256_of(path) if known is None else known.sha256(path)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
