"""Whether a worker is good for the same bytes: it sees the workspace and the logs, and computes with the same code."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

from maglev_offline.agents.engine import native_availability
from maglev_offline.errors import InputError
from maglev_offline.manifest import package_versions
from maglev_offline.progress import Progress

SEEN_S = 10.0
"""So long a file may take to be seen on another machine: a network drive asks for news every few seconds."""


class Looker:
    """A look around, done on a worker: what this Python is, what the word file holds, and how large the logs are."""

    def __init__(self, word_file: Path, logs: tuple[Path, ...]) -> None:
        self.word_file, self.logs = word_file, logs

    def __call__(self) -> dict[str, Any]:
        """Look."""
        return {
            "python": platform.python_version(),
            "versions": package_versions(),
            "computes": native_availability()[1],
            "word": _read(self.word_file),
            "logs": {str(log): _size(log) for log in self.logs},
        }


def check(
    ask: Callable[[Callable[[], Any]], dict[str, Any]], root: Path, logs: tuple[Path, ...], progress: Progress
) -> None:
    """Ask every worker to look around, and compare; warn of what makes other bytes.

    Raises
    ------
    InputError: a worker does not see the workspace or the logs, or has another maglev-offline or Python.
    """
    word = uuid4().hex
    path = root.absolute() / f".seen.{word[:8]}.draft"  # swept away by the next command if this one is killed
    path.write_text(word)
    try:
        look = Looker(path, _one_of_each_folder(logs))
        here, found = look(), ask(look)
    finally:
        path.unlink(missing_ok=True)
    if not found:
        raise InputError("the cluster has no workers.", todo="Start some.")
    for name, there in found.items():
        _refuse(name, here, there, root)
    _warn_of_others(here, found, progress)


def _refuse(name: str, here: Mapping[str, Any], there: Any, root: Path) -> None:
    where = f"worker {name}"
    if not isinstance(there, dict):
        raise InputError(
            f"it cannot look around ({type(there).__name__}: {_last_line(there)}).",
            where=where,
            todo="Install the same version of maglev-offline into the Python of every worker.",
        )
    code = {
        name: (one["versions"]["maglev-offline"], _minor(one["python"])) for name, one in (("", here), ("there", there))
    }
    if code[""] != code["there"]:
        raise InputError(
            f"it has maglev-offline {code['there'][0]} and Python {code['there'][1]}, and this machine "
            f"{code[''][0]} and {code[''][1]}.",
            where=where,
            todo="Install the same versions on every machine.",
        )
    if there["word"] != here["word"]:
        raise InputError(
            f"it does not see the workspace {root.absolute()}.",
            where=where,
            todo="Put the workspace into a folder that every machine has under the same path (a network drive). Where "
            "it is an address, that is its mirror: set MAGLEV_OFFLINE_CACHE to such a folder.",
        )
    unseen = [log for log, size in here["logs"].items() if there["logs"].get(log) != size]
    if unseen:
        raise InputError(
            f"it does not see the log {unseen[0]}, or another one under that name.",
            where=where,
            todo="Put the logs where every machine has them under the same path, or into a store (s3://...).",
        )


def _warn_of_others(here: Mapping[str, Any], found: Mapping[str, Mapping[str, Any]], progress: Progress) -> None:
    for name, there in found.items():
        other = {
            package: (there["versions"].get(package), version)
            for package, version in here["versions"].items()
            if there["versions"].get(package) != version
        }
        told = [f"{package} {theirs} instead of {ours}" for package, (theirs, ours) in sorted(other.items())]
        if there["computes"] != here["computes"]:
            told.append(f"another native engine ({there['computes']}) than here ({here['computes']})")
        if told:
            progress.warn(f"worker {name} has {', '.join(told)}: what it makes may differ in the last bits.")


def _last_line(error: Any) -> str:
    return next(reversed(str(error).strip().splitlines()), "")


def _minor(version: str) -> str:
    return ".".join(version.split(".")[:2])


def _one_of_each_folder(logs: tuple[Path, ...]) -> tuple[Path, ...]:
    return tuple({log.absolute().parent: log.absolute() for log in logs}.values())


def _read(path: Path) -> str:
    until = time.monotonic() + SEEN_S
    while True:
        try:
            return path.read_text()
        except OSError:
            if not path.parent.is_dir() or time.monotonic() > until:
                return ""
            time.sleep(0.5)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return -1
