"""Where artefacts lie: one folder each, committed whole or not at all, with a manifest of where it came from."""

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from maglev_offline import __version__
from maglev_offline.errors import ArtefactError, InputError, WorkspaceLocked
from maglev_offline.hashes import KnownHashes, Stamp, stamp_of
from maglev_offline.hashes import sha256_of as sha256_of
from maglev_offline.settings import Settings

SCHEMA = 1
"""Version of the layout of artefacts; a reader refuses any other."""

KNOWN_HASHES = ".known_hashes.json"
"""File of the workspace in which the hashes of logs and artefacts are kept; see `hashes`. It may be removed."""

_RECORDED_PACKAGES = ("control", "matplotlib", "mcap", "numpy", "pandas", "pyarrow", "scipy", "torch")


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


def package_versions() -> dict[str, str]:
    """Versions of the packages that can change an artefact's bytes."""
    found = {"maglev-offline": __version__}
    for name in _RECORDED_PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # an optional package that is not there changes nothing
            continue
    return found


@dataclass
class Manifest:
    """What an artefact is made of; written as `manifest.json` in its folder.

    `counts` are rows and messages; `left_out` counts by reason code what was not used; `facts` are the
    stage's own findings. No wall-clock time: the same inputs give the same bytes.
    """

    artefact: str
    fingerprint: str
    inputs: dict[str, str]
    counts: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, int] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=package_versions)
    schema: int = SCHEMA

    @classmethod
    def read(cls, folder: Path) -> "Manifest":
        """Read the manifest of the artefact in `folder`.

        Raises
        ------
        ArtefactError: there is none, or it was written by another schema.
        """
        path = folder / "manifest.json"
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            if data.get("schema") != SCHEMA:
                raise ArtefactError(
                    f"the artefact has schema {data.get('schema')!r}, this version reads {SCHEMA}.",
                    where=str(folder),
                    todo="Remove the workspace and run the stages again.",
                )
            return cls(**data)
        except (FileNotFoundError, NotADirectoryError):
            raise ArtefactError(
                "there is no such artefact.", where=str(folder), todo="Run the stage that makes it first."
            ) from None
        except (OSError, ValueError, TypeError, AttributeError) as error:
            raise ArtefactError(
                f"the manifest cannot be read ({error}).",
                where=str(path),
                todo="Remove the folder and run again.",
            ) from None


class Workspace:
    """A folder of artefacts. Readers see whole artefacts only; one command writes at a time."""

    def __init__(self, root: Path, *, rehash: bool = False) -> None:
        self.root, self.rehash = root, rehash
        self._manifests: dict[Path, tuple[Stamp, Manifest]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Go to a worker process without hashes and manifests, which are many and not its business."""
        return {"root": self.root, "rehash": self.rehash, "_manifests": {}}

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
        """
        folder.parent.mkdir(parents=True, exist_ok=True)
        draft = folder.parent / f".{folder.name}.draft"
        retired = folder.parent / f".{folder.name}.old"
        for leftover in (draft, retired):
            shutil.rmtree(leftover, ignore_errors=True)
        draft.mkdir()
        try:
            yield draft
            files = sorted(p for p in draft.rglob("*") if p.is_file())
            manifest.files = {p.relative_to(draft).as_posix(): sha256_of(p) for p in files}
            text = json.dumps(asdict(manifest), indent=2, sort_keys=True, allow_nan=False) + "\n"
            (draft / "manifest.json").write_text(text)
            for path in (*files, draft / "manifest.json"):
                _sync(path)
            if folder.exists():
                folder.rename(retired)
            try:
                draft.rename(folder)
            except OSError:
                if retired.exists():
                    retired.rename(folder)
                raise
            _sync(folder.parent)
        finally:
            for leftover in (draft, retired):
                shutil.rmtree(leftover, ignore_errors=True)

    def holder(self) -> str | None:
        """The command that holds the workspace for writing, and its process; None where nobody does.

        A command that was killed leaves its name behind, but not the lock.
        """
        try:
            with (self.root / ".lock").open() as file:
                found = file.read().strip()
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
                holder = file.read().strip() or "another command"
                raise WorkspaceLocked(
                    f"the workspace is in use by {holder}.",
                    where=str(self.root),
                    todo="Wait for it to end, or use another --workspace.",
                ) from None
            file.truncate(0)
            file.write(f"`maglev-offline {command}` (process {os.getpid()})")
            file.flush()
            try:
                yield
            finally:
                if "known" in self.__dict__:
                    self.known.save()
                file.truncate(0)


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
