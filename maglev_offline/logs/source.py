"""Where the bytes of a log come from: a local file, or any file system that pyarrow reaches by a URI."""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from maglev_offline.errors import InputError, LogError
from maglev_offline.filesystems import in_words, is_address, open_address, shown

MAGIC = b"\x89MCAP0\r\n"

_BLOCK_BYTES = 2**20


@dataclass(frozen=True)
class Source:
    """An open log of `size` bytes.

    `name` is what the user called it, without secrets; `local` says that small reads cost little.
    """

    name: str
    size: int
    local: bool
    _read: Callable[[int, int], bytes]

    def read_at(self, offset: int, length: int) -> bytes:
        """Read `length` bytes at `offset`; fewer at the end of the file, none behind it.

        Raises
        ------
        LogError: the disk or the network fails.
        """
        length = min(length, self.size - offset)
        if length <= 0:
            return b""
        try:
            return self._read(offset, length)
        except (OSError, ValueError) as error:
            raise LogError(
                f"the log cannot be read at byte {offset:,} ({_reason(error)}).",
                where=self.name,
                todo="Check the disk or the network, or copy the log to another place.",
            ) from None

    def sha256(self) -> str:
        """Hash of all its bytes, hexadecimal."""
        hashed = hashlib.sha256()
        for offset in range(0, self.size, _BLOCK_BYTES):
            hashed.update(self.read_at(offset, _BLOCK_BYTES))
        return hashed.hexdigest()


def is_uri(where: str | Path) -> bool:
    """Whether this names a file by a URI (`s3://bucket/a.mcap`), and not by a local path."""
    return isinstance(where, str) and is_address(where)


_ARCHIVES = (b"PK\x03\x04", b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf")
"""How files of zip, gzip, Zstandard and 7-Zip begin."""


def _instead(begins: bytes, name: str) -> str:
    """What to do with a file that is no MCAP file, by its first bytes and its name."""
    if begins.startswith(b"#ROSBAG") or name.endswith((".bag", ".db3")):
        return "It is a ROS bag: make an MCAP file of it with the tool of the MCAP project, `mcap convert IN OUT.mcap`."
    if begins.startswith(_ARCHIVES):
        return "It is an archive: unpack it, and give the .mcap files that are in it."
    if name.endswith(".toml"):
        return "It is a recipe, it seems: give it with --recipe, and the logs beside it."
    return "Give the .mcap file, or convert the log to MCAP first."


@contextmanager
def open_source(where: str | Path) -> Iterator[Source]:
    """Open a log for reading at any place; a URI goes through pyarrow, all else is a local path.

    Raises
    ------
    LogError: it cannot be opened, is a folder, is empty, or does not begin as an MCAP file does.
    """
    with _open_remote(str(where)) if is_uri(where) else _open_local(Path(where)) as source:
        if source.size == 0:
            raise LogError("the file is empty (0 bytes).", where=source.name, todo="Copy it again from the recorder.")
        begins = source.read_at(0, min(source.size, 16))
        if not begins.startswith(MAGIC):
            raise LogError(
                "this is not an MCAP file: it does not begin with the MCAP magic bytes.",
                where=source.name,
                todo=_instead(begins, source.name),
            )
        yield source


@contextmanager
def _open_local(path: Path) -> Iterator[Source]:
    where = str(path)
    if path.is_dir():
        raise _folder(where)
    try:
        file = path.open("rb", buffering=0)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the path
        raise _cannot_be_opened(where, error) from None
    with file:
        descriptor = file.fileno()

        def read(offset: int, length: int) -> bytes:
            found = os.pread(descriptor, length, offset)
            if len(found) == length or not found:
                return found
            # A single read gives at most 2 GiB, and less where a signal comes in between.
            parts = [found]
            while length > (got := sum(map(len, parts))):
                parts.append(os.pread(descriptor, length - got, offset + got))
                if not parts[-1]:
                    break
            return b"".join(parts)

        yield Source(where, os.fstat(descriptor).st_size, True, read)


@contextmanager
def _open_remote(uri: str) -> Iterator[Source]:
    from pyarrow import fs

    where = shown(uri)
    try:
        filesystem, path = open_address(uri)
        with in_words(uri):
            folder = filesystem.get_file_info(path).type == fs.FileType.Directory
            file = None if folder else filesystem.open_input_file(path)
    except InputError as error:
        raise LogError(f"the log cannot be opened: {error.what}", where=where, todo=error.todo) from None
    if file is None:
        raise _folder(where)
    with file:
        local = isinstance(filesystem, fs.LocalFileSystem)
        yield Source(where, int(file.size()), local, lambda offset, length: file.read_at(length, offset))


def _folder(where: str) -> LogError:
    return LogError("this is a folder, not a log.", where=where, todo="Name the .mcap files in it.")


def _cannot_be_opened(where: str, error: Exception) -> LogError:
    return LogError(
        f"the log cannot be opened ({_reason(error)}).", where=where, todo="Check the path and the rights to read it."
    )


def _reason(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error) or type(error).__name__).strip().rstrip(".")
