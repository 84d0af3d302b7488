"""What is half-written, or put aside for a moment: how it is named, and how it goes away after a command was killed."""

import os
import re
import secrets
import shutil
from pathlib import Path

_LEFT = re.compile(r"\.(.+)\.[0-9a-f]{8}\.(draft|old)")
"""Names that only these modules give: a user's files may lie beside."""

_DEPTH = 5
"""Artefacts lie no deeper than `periods/5ms/training/ARM/BLOCK`."""


def draft_and_retired(folder: Path) -> tuple[Path, Path]:
    """Where an artefact is written, and where the one goes for a moment that it takes the place of.

    Names of their own: a worker of a killed command, here or elsewhere, may be at work on the same artefact.
    """
    token = secrets.token_hex(4)
    return folder.parent / f".{folder.name}.{token}.draft", folder.parent / f".{folder.name}.{token}.old"


def sweep(root: Path) -> None:
    """Remove what a killed command left half-written; an artefact that it had put aside goes back to its place."""
    for home, folders, files in os.walk(root):
        for name in (*folders, *files):
            if (found := _LEFT.fullmatch(name)) is None:
                continue
            path, place = Path(home, name), Path(home, found[1])
            if found[2] == "old" and (path / "manifest.json").is_file() and not place.exists():
                path.rename(place)
            elif path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
        deep = len(Path(home).relative_to(root).parts) >= _DEPTH or "manifest.json" in files
        folders[:] = [] if deep else [name for name in folders if not name.startswith(".")]
