"""A folder in a store of files: list, read, write whole or not at all, and a lock that says who holds it."""

import hashlib
import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from maglev_offline.errors import ArtefactError, InputError, WorkspaceLocked
from maglev_offline.filesystems import below, in_words, open_address, shown

LOCK = ".lock.json"
BLOCK_BYTES = 4 * 2**20


class Entry(NamedTuple):
    """Size of a file in a store, and its time of modification where the store tells it."""

    size: int
    modified_ns: int | None


@dataclass(frozen=True)
class Store:
    """A folder: pyarrow's file system, the path in it, and its address for people. Errors are InputErrors."""

    files: Any
    home: str
    address: str

    @classmethod
    def open(cls, address: str) -> "Store":
        """Open the folder of an address; it need not be there yet."""
        files, home = open_address(address)
        return cls(files, home.rstrip("/"), address)

    def list(self) -> dict[str, Entry]:
        """Every file below the folder by its relative path, without those whose names begin with a dot."""
        from pyarrow import fs

        with in_words(self.address):
            found = self.files.get_file_info(fs.FileSelector(self.home, recursive=True, allow_not_found=True))
        entries = {e.path[len(self.home) + 1 :]: Entry(e.size, e.mtime_ns) for e in found if e.type == fs.FileType.File}
        return {name: entry for name, entry in sorted(entries.items()) if _is_plain(name)}

    def read(self, name: str) -> bytes | None:
        """Content of a small file; None where there is none."""
        with in_words(self.where(name)):
            try:
                with self.files.open_input_stream(f"{self.home}/{name}") as stream:
                    return bytes(stream.read())
            except FileNotFoundError:
                return None

    def fetch(self, name: str, target: Path, sha256: str) -> None:
        """Bring a file here.

        Raises
        ------
        ArtefactError: it is not what its hash says.
        """
        found = hashlib.sha256()
        with in_words(self.where(name)):
            stream = self.files.open_input_stream(f"{self.home}/{name}")
        with stream, target.open("wb") as file, in_words(self.where(name)):
            while block := stream.read(BLOCK_BYTES):
                found.update(block)
                file.write(block)
        if found.hexdigest() != sha256:
            raise ArtefactError(
                "the file in the store is not what was written there.",
                where=self.where(name),
                todo="Remove the folder of its artefact there, and run its stage again.",
            )

    def send(self, source: Path, name: str) -> None:
        """Write a large file under a name that no reader knows yet; a failure may leave a part of it there."""
        with in_words(self.where(name)), source.open("rb") as file:
            self._write(name, iter(lambda: file.read(BLOCK_BYTES), b""))

    def put(self, name: str, content: bytes) -> None:
        """Write a small file, whole or not at all, also in the place of an older one."""
        folder, _, last = name.rpartition("/")
        draft = f"{folder}/.{last}.draft" if folder else f".{last}.draft"
        with in_words(self.where(name)):
            self._write(draft, iter([content]))
            self.files.move(f"{self.home}/{draft}", f"{self.home}/{name}")

    def remove(self, name: str) -> None:
        """Remove a file; it may be gone already."""
        with in_words(self.where(name)), suppress(FileNotFoundError):
            self.files.delete_file(f"{self.home}/{name}")

    def remove_folder(self, name: str) -> None:
        """Remove a folder and all that is in it; it may be gone already."""
        with in_words(self.where(name)), suppress(FileNotFoundError):
            self.files.delete_dir(f"{self.home}/{name}")

    def holder(self) -> WorkspaceLocked | None:
        """What a command is told that wants the lock now; None where it is free."""
        held = self.read(LOCK)
        return None if held is None or _is_dead(held) else self._locked(held)

    @contextmanager
    def lock(self, command: str) -> Iterator[None]:
        """Hold the folder for one command, as well as a store without a true lock allows.

        Two commands that begin in the same instant may both believe that they hold it only if the store shows one
        of them an old state. A lock whose process is gone from this very machine is taken over.

        Raises
        ------
        WorkspaceLocked: another command holds it; the message says which, where, and since when.
        """
        mine = {"command": command, "host": socket.gethostname(), "process": os.getpid()}
        content = json.dumps(mine, sort_keys=True).encode()
        held = self.holder()
        if held is not None:
            raise held
        self.put(LOCK, content)
        there = self.read(LOCK)
        if there != content:
            raise self._locked(there or b"{}")
        try:
            yield
        finally:
            with suppress(InputError):
                if self.read(LOCK) == content:
                    self.remove(LOCK)

    def _write(self, name: str, blocks: Iterator[bytes]) -> None:
        path = f"{self.home}/{name}"
        try:
            stream = self.files.open_output_stream(path)
        except FileNotFoundError:  # a store of objects has no folders, and is not asked to make any
            self.files.create_dir(path.rpartition("/")[0], recursive=True)
            stream = self.files.open_output_stream(path)
        with stream:
            for block in blocks:
                stream.write(block)

    def where(self, name: str) -> str:
        """Address of a file for people."""
        return shown(below(self.address, name))

    def _locked(self, held: bytes) -> WorkspaceLocked:
        found = _holder(held)
        since = ""
        with suppress(InputError), in_words(self.address):
            modified = self.files.get_file_info(f"{self.home}/{LOCK}").mtime
            since = f" since {modified:%Y-%m-%d %H:%M:%S} UTC" if modified is not None else ""
        command = f"`maglev-offline {found['command']}`" if found.get("command") else "another command"
        who = f"{command} (process {found.get('process', '?')} on {found.get('host', 'an unknown machine')}){since}"
        return WorkspaceLocked(
            f"the workspace is in use by {who}.",
            where=shown(self.address),
            todo=f"Wait for it to end. If it is dead, remove {self.where(LOCK)}.",
        )


def _is_plain(name: str) -> bool:
    """Whether a name leads below the folder, and to nothing hidden; a key of a store may be anything."""
    return not any(not part or part.startswith(".") or "\0" in part for part in name.split("/"))


def _holder(held: bytes) -> dict[str, Any]:
    try:
        found = json.loads(held)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _is_dead(held: bytes) -> bool:
    """Whether the holder ran on this machine and does no more."""
    found = _holder(held)
    if found.get("host") != socket.gethostname() or not isinstance(found.get("process"), int):
        return False
    try:
        os.kill(found["process"], 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False
    return False
