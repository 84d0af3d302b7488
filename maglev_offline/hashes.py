"""Hashes of files, kept so that a file that was not touched is not read again."""

import hashlib
import json
import os
import secrets
import time
from pathlib import Path
from typing import Any, NamedTuple

VERSION = 1

SETTLED_NS = 50_000_000
"""A file's times count in ticks of the kernel (up to 10 ms), so that a file that is written, hashed and written again
within one looks untouched. A hash is kept only of a file that has been left alone for longer than that."""

SETTLED_COARSE_NS = 2_500_000_000
"""The same for a file system that counts in seconds (in two, on FAT)."""


class Stamp(NamedTuple):
    """What tells that a file was touched. `changed_ns` and `inode` are 0 for an object that is not a local file."""

    size: int
    modified_ns: int
    changed_ns: int = 0
    inode: int = 0


def stamp_of(path: Path | str) -> Stamp:
    """Stamp of a local file; raises OSError as stat does."""
    found = os.stat(path)  # noqa: PTH116 (thousands of them: a Path each would take longer than the call)
    return Stamp(found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino)


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class KnownHashes:
    """Hashes by name of file, each with the stamp that the file had; kept in one small JSON file.

    The rule of trust: a file whose size, time of modification, time of change and inode are what they were when it was
    hashed is the same file. Where that is not enough (a clock that was set back, a program that writes through a
    memory map that it holds open, a network drive that is late, a store that tells nothing but size and time),
    `distrust` reads every file once more.

    A file that cannot be read, is damaged, or is of another version is the same as none: all is hashed again.
    """

    def __init__(self, path: Path, *, distrust: bool = False) -> None:
        self.path = path
        self._kept = {} if distrust else _read(path)
        self._used: dict[str, tuple[Stamp, str]] = {}
        self._new = distrust

    def sha256(self, path: Path) -> str:
        """Hash of a local file, read only if it was touched since; raises OSError as reading does."""
        name = os.path.abspath(path)  # noqa: PTH100 (as above, and links must not be followed: the name is the key)
        stamp = stamp_of(name)
        known = self.recall(name, stamp)
        if known is not None:
            return known
        found = sha256_of(path)
        if stamp_of(name) == stamp and settled(stamp, time.time_ns()):
            self.keep(name, stamp, found)
        return found

    def recall(self, name: str, stamp: Stamp) -> str | None:
        """Hash that was kept of `name`, if its stamp is still the same."""
        entry = self._used.get(name) or self._kept.get(name)
        if entry is None or entry[0] != stamp:
            return None
        self._used[name] = entry
        return entry[1]

    def keep(self, name: str, stamp: Stamp, sha256: str) -> None:
        """Keep the hash of `name`."""
        self._used[name] = (stamp, sha256)
        self._new = True

    def save(self) -> None:
        """Write what is known, whole or not at all; what concerns local files that are gone is dropped.

        A cache that cannot be written is no failure: the next run takes longer.
        """
        if not self._new:
            return
        # Names that this run did not ask for stay: another command of the same workspace may.
        kept = {name: entry for name, entry in (self._kept | self._used).items() if _may_be_there(name, entry[0])}
        data = {"version": VERSION, "files": {name: [*stamp, sha256] for name, (stamp, sha256) in sorted(kept.items())}}
        draft = self.path.with_name(f"{self.path.name}.{secrets.token_hex(4)}.draft")
        try:
            draft.write_text(json.dumps(data, separators=(",", ":")), encoding="utf-8", errors="surrogateescape")
            draft.replace(self.path)
        except OSError:
            draft.unlink(missing_ok=True)
            return
        self._kept, self._new = kept, False


def settled(stamp: Stamp, now_ns: int) -> bool:
    """Whether a file has been left alone for long enough that a later change must show in its stamp."""
    latest = max(stamp.modified_ns, stamp.changed_ns)
    coarse = stamp.modified_ns % 1_000_000_000 == 0 and stamp.changed_ns % 1_000_000_000 == 0
    return now_ns - latest > (SETTLED_COARSE_NS if coarse else SETTLED_NS)


def _may_be_there(name: str, stamp: Stamp) -> bool:
    return stamp.inode == 0 or os.path.exists(name)  # noqa: PTH110 (thousands of them)


def _read(path: Path) -> dict[str, tuple[Stamp, str]]:
    try:
        data = json.loads(path.read_text(encoding="utf-8", errors="surrogateescape"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(data, dict) or data.get("version") != VERSION or not isinstance(data.get("files"), dict):
        return {}
    return {name: entry for name, value in data["files"].items() if (entry := _entry(value)) is not None}


def _entry(value: Any) -> tuple[Stamp, str] | None:
    """One entry, or None where it is not one."""
    match value:
        case [int(), int(), int(), int(), str(sha256)] if len(sha256) == 64:
            return Stamp(*value[:4]), sha256
    return None
