"""Where artefacts lie: one folder each, committed whole or not at all, with a manifest of where it came from."""

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from maglev_offline import __version__
from maglev_offline.errors import ArtefactError, InputError, WorkspaceLocked
from maglev_offline.settings import Settings

SCHEMA = 1
"""Version of the layout of artefacts; a reader refuses any other."""

_RECORDED_PACKAGES = ("control", "matplotlib", "mcap", "numpy", "pandas", "pyarrow", "scipy", "torch")


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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

    def __init__(self, root: Path) -> None:
        self.root = root

    def path(self, *parts: str) -> Path:
        """Folder of an artefact, for instance `path("samples", log_id)`."""
        return self.root.joinpath(*parts)

    def is_current(self, folder: Path, mark: str) -> bool:
        """Whether the artefact in `folder` is whole and was made from what `mark` stands for."""
        try:
            manifest = Manifest.read(folder)
        except ArtefactError:
            return False
        return manifest.fingerprint == mark and not changed_files(folder, manifest)

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
                file.truncate(0)


def changed_files(folder: Path, manifest: Manifest) -> list[str]:
    """Files of an artefact that are gone, or are not what was written."""
    return [
        name
        for name, known in manifest.files.items()
        if not (folder / name).is_file() or sha256_of(folder / name) != known
    ]


def input_hash(folder: Path) -> str:
    """Hash that stands for a whole artefact: that of its manifest, which holds the hash of each of its files.

    Raises
    ------
    ArtefactError: a file of the artefact is gone, or is not what was written.
    """
    changed = changed_files(folder, Manifest.read(folder))
    if changed:
        raise ArtefactError(
            f"{', '.join(changed)} {'is' if len(changed) == 1 else 'are'} not what was written there.",
            where=str(folder),
            todo="Remove that folder and run its stage again.",
        )
    return sha256_of(folder / "manifest.json")


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
