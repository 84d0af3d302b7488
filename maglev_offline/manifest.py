"""The manifest of an artefact: what it was made of, what came out, and the hashes of its files."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePosixPath
from typing import Any

from maglev_offline import __version__
from maglev_offline.errors import ArtefactError

SCHEMA = 1
"""Version of the layout of artefacts; a reader refuses any other."""

_RECORDED_PACKAGES = ("control", "matplotlib", "mcap", "numpy", "pandas", "pyarrow", "scipy", "torch")


def package_versions() -> dict[str, str]:
    """Versions of the packages that can change an artefact's bytes."""
    known = {name: _version_of(name) for name in _RECORDED_PACKAGES}
    # An optional package that is not there changes nothing.
    return {"maglev-offline": __version__, **{name: found for name, found in known.items() if found is not None}}


@cache
def _version_of(package: str) -> str | None:
    """Kept, since to look it up takes 1 ms, and there may be thousands of logs."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@dataclass
class Manifest:
    """What an artefact is made of; written as `manifest.json` in its folder.

    `counts` are rows and messages; `left_out` counts by reason code what was not used; `facts` are the
    stage's own findings. No wall-clock time: the same inputs give the same bytes. `seal` is the hash of all the rest;
    it is empty in artefacts of older versions, whose manifests are taken as they are.
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
    seal: str = ""

    def sealed(self) -> str:
        """The file's text, with the hash of all the rest in it."""
        data = json.loads(json.dumps(asdict(self), allow_nan=False))  # as it will be read
        return json.dumps(data | {"seal": _seal_of(data)}, indent=2, sort_keys=True) + "\n"

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
            found = cls(**data)
            found._check(data)
            return found
        except (FileNotFoundError, NotADirectoryError):
            raise ArtefactError(
                "there is no such artefact.", where=str(folder), todo="Run the stage that makes it first."
            ) from None
        except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
            raise ArtefactError(
                f"the manifest cannot be read ({error}).",
                where=str(path),
                todo="Remove the folder and run again.",
            ) from None

    def _check(self, data: dict[str, Any]) -> None:
        """Raise ValueError where this is no manifest of ours, or is not what was written."""
        for one in fields(self):
            kind = {"artefact": str, "fingerprint": str, "schema": int, "seal": str}.get(one.name, dict)
            if not isinstance(getattr(self, one.name), kind):
                raise ValueError(f"{one.name} is no {kind.__name__}")
        for name, sha256 in self.files.items():
            path = PurePosixPath(name)
            if path.is_absolute() or ".." in path.parts or "\0" in name or not isinstance(sha256, str):
                raise ValueError(f"{name!r} is no file of the artefact")
        if self.seal and self.seal != _seal_of(data):
            raise ValueError("it is not what was written")


def _seal_of(data: Mapping[str, Any]) -> str:
    rest = {name: value for name, value in data.items() if name != "seal"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()
