"""What is to be ingested: which files make one artefact, under which name and hash."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from maglev_offline.errors import LogError
from maglev_offline.filesystems import Where, name_of
from maglev_offline.hashes import Stamp, stamp_of
from maglev_offline.ingest.merge import merged_sha256
from maglev_offline.ingest.request import Request

KIND = "samples"
"""The kind of artefact, and its folder in the workspace."""


@dataclass(frozen=True)
class LogTask:
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
        """The first file, which the outcome is of."""
        return self.parts[0]

    @property
    def name(self) -> str:
        """The files, for people."""
        return " + ".join(name_of(part) for part in self.parts)


def tasks_of(
    hashes: dict[Where, str], stamps: Mapping[Where, Stamp], request: Request, *, merge: bool
) -> Iterator[LogTask]:
    """A task for each log, or with `merge` one for all of them."""
    groups = [tuple(hashes)] if merge and hashes else [(where,) for where in hashes]
    for parts in groups:
        sha256 = hashes[parts[0]] if len(parts) == 1 else merged_sha256(hashes[part] for part in parts)
        before = tuple((part, stamps[part]) for part in parts if isinstance(part, Path) and part in stamps)
        yield LogTask(parts, log_id_of(parts[0], sha256), sha256, request.fingerprint(KIND, sha256), before)


def log_id_of(where: Where, sha256: str) -> str:
    """Name of a log in every artefact: the file's stem, made safe for a file name, and a piece of its hash."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name_of(where).removesuffix(".mcap")).lstrip(".-") or "log"
    return f"{stem[:80]}-{sha256[:8]}"


def refuse_changed(task: LogTask) -> None:
    """See that each local log is still the file that was hashed: else its samples would lie under a hash of others.

    Raises
    ------
    LogError: it was changed or removed.
    """
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
