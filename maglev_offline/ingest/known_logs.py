"""The hashes of logs, local or in a store, kept so that a log that was not touched is not read again; see `hashes`.

The rule of trust for an object in a store is weaker than that for a local file, since a store tells size and time of
modification only: two objects of one size, written in the same second under one name, are taken for one. `--rehash`
(`Workspace(root, rehash=True)`) reads every log once more.
"""

import hashlib
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maglev_offline.errors import InputError, LogError
from maglev_offline.filesystems import Where, in_words, name_of, open_address, shown
from maglev_offline.hashes import KnownHashes, Stamp, settled, stamp_of

BLOCK_BYTES = 4 * 2**20
"""How much of a log in a store is held at once."""


def recall(where: Where, known: KnownHashes) -> str | None:
    """Hash of a log that was not touched since it was kept; None where it must be read, or is not there at all."""
    try:
        if isinstance(where, Path):
            return known.recall(os.path.abspath(where), stamp_of(where))  # noqa: PTH100 (links are not followed)
        stamp = _stamp_in_store(where)
    except (InputError, OSError):
        return None
    return None if stamp is None else known.recall(where, stamp)


def hash_of_log(where: Where, known: KnownHashes) -> str:
    """Hash of a log's bytes; a log in a store is read once, block by block, and not kept.

    Raises
    ------
    LogError: it is not there or cannot be read.
    """
    known_already = recall(where, known)
    if known_already is not None:
        return known_already
    if isinstance(where, Path):
        try:
            return known.sha256(where)
        except OSError as error:
            raise _unreadable(where, error.strerror or str(error)) from None
    with _as_log_errors(where):
        stamp = _stamp_in_store(where)
        found = hashlib.sha256()
        for block in _blocks(where):
            found.update(block)
    if stamp is not None and settled(stamp, time.time_ns()):
        known.keep(where, stamp, found.hexdigest())
    return found.hexdigest()


@contextmanager
def at_hand(where: Where, folder: Path, sha256: str) -> Iterator[Path]:
    """A local file with the log's content: the log itself, or a copy in `folder` that is removed on leaving.

    `sha256` is what `hash_of_log` said, and a copy is held against it.

    Raises
    ------
    LogError: it cannot be read, or it has changed since it was hashed.
    """
    if isinstance(where, Path):
        yield where
        return
    folder.mkdir(parents=True, exist_ok=True)
    # The name in the store is not to be trusted as a name here; the suffix alone tells nothing but the format.
    with tempfile.TemporaryDirectory(prefix="log-", dir=folder) as home:
        copy = Path(home) / "log.mcap"
        found = hashlib.sha256()
        with _as_log_errors(where), copy.open("wb") as file:
            for block in _blocks(where):
                found.update(block)
                file.write(block)
        if found.hexdigest() != sha256:
            raise LogError(
                "the log has changed while it was read.",
                where=shown(where),
                todo="Wait until the recorder is done with it, and run again.",
            )
        yield copy


def file_name(where: Where) -> str:
    """Name of the log for tables and artefacts."""
    return name_of(where)


def _blocks(address: str) -> Iterator[bytes]:
    store, path = open_address(address)
    with store.open_input_stream(path) as stream:
        while block := stream.read(BLOCK_BYTES):
            yield block


def _stamp_in_store(address: str) -> Stamp | None:
    """Size and time of an object; None where the store does not tell them, or there is no such object."""
    store, path = open_address(address)
    with in_words(address):
        entry = store.get_file_info(path)
    if entry.size is None or entry.mtime_ns is None:
        return None
    return Stamp(entry.size, entry.mtime_ns)


@contextmanager
def _as_log_errors(where: str) -> Iterator[None]:
    """A log that cannot be read is refused like any other, and the others go on."""
    try:
        with in_words(where):
            yield
    except InputError as error:
        raise LogError(error.what, where=error.where, todo=error.todo) from None


def _unreadable(path: Path, why: str) -> LogError:
    return LogError(
        f"the log cannot be opened ({why}).", where=str(path), todo="Check the path and the rights to read it."
    )
