"""The records of an MCAP file in file order, every check sum checked, every failure told in plain words."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.reader import SeekingReader
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.summary import Summary

from maglev_offline.errors import LogError

MAGIC = b"\x89MCAP0\r\n"

LARGEST_CHUNK_BYTES = 2**31
"""A chunk that claims to be larger is refused before memory is asked for it; recorders write a few MiB."""

_COMPRESSIONS = ("", "zstd", "lz4")

_DAMAGE = (
    McapError,
    ValueError,  # CRCValidationError is one, UnicodeDecodeError too
    struct.error,
    zstandard.ZstdError,
    RuntimeError,  # what lz4 raises; StopIteration of a generator ends as one as well
    LookupError,
    EOFError,
    ArithmeticError,
    MemoryError,
    OSError,
)


def walk(path: Path) -> Iterator[McapRecord]:
    """Yield every record of the file in file order, one pass; after each Chunk record come the records inside it.

    Raises
    ------
    LogError: the file cannot be opened, is empty, is no MCAP file, is cut off, or is damaged.
    """
    with open_log(path) as file:
        try:
            for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
                yield record
                if isinstance(record, Chunk):
                    _check_chunk(path, record)
                    yield from breakup_chunk(record, validate_crc=True)
        except _DAMAGE as error:
            raise _damaged(path, error, file.tell()) from None


def read_summary(path: Path) -> Summary | None:
    """Read the summary section at the end of the file; None where there is none that can be read.

    Raises LogError as `walk` does for a file that cannot be opened, is empty, is no MCAP file, or is cut off.
    """
    with open_log(path) as file:
        try:
            return SeekingReader(file, validate_crcs=True).get_summary()
        except _DAMAGE:
            return None


@contextmanager
def open_log(path: Path) -> Iterator[BinaryIO]:
    """Open a log after a look at its two ends.

    Raises
    ------
    LogError: it cannot be opened, is empty, is no MCAP file, or is cut off.
    """
    where = str(path)
    if path.is_dir():
        raise LogError("this is a folder, not a log.", where=where, todo="Name the .mcap files in it.")
    try:
        file = path.open("rb")
    except OSError as error:
        raise LogError(
            f"the log cannot be opened ({error.strerror or error}).",
            where=where,
            todo="Check the path and the rights to read it.",
        ) from None
    with file:
        size = file.seek(0, 2)
        if size == 0:
            raise LogError("the file is empty (0 bytes).", where=where, todo="Copy it again from the recorder.")
        file.seek(0)
        if file.read(len(MAGIC)) != MAGIC:
            raise LogError(
                "this is not an MCAP file: it does not begin with the MCAP magic bytes.",
                where=where,
                todo="Give the .mcap file, or convert the log to MCAP first.",
            )
        file.seek(max(size - len(MAGIC), 0))
        if size < 2 * len(MAGIC) or file.read(len(MAGIC)) != MAGIC:
            raise LogError(
                f"the log is cut off: after {size:,} bytes it ends without the MCAP footer.",
                where=where,
                todo="The recorder was stopped hard, or the copy was not finished. Copy it again, or write a whole "
                "file from what is left with `mcap recover` of the MCAP command line tool, and use that.",
            )
        file.seek(0)
        yield file


def _check_chunk(path: Path, chunk: Chunk) -> None:
    # The library takes a compression that it does not know for none at all, so it is refused here.
    if chunk.compression not in _COMPRESSIONS:
        raise LogError(
            f"the log is compressed with {chunk.compression!r}, which cannot be read.",
            where=str(path),
            todo="Write it again with zstd, lz4 or no compression (`mcap compress --compression zstd`).",
        )
    claimed = chunk.uncompressed_size
    if chunk.compression == "zstd":
        in_frame = zstandard.frame_content_size(chunk.data)
        if in_frame not in (-1, claimed):
            raise McapError(f"a chunk says that it holds {claimed:,} bytes, its zstd frame says {in_frame:,}")
    if claimed > LARGEST_CHUNK_BYTES:
        raise McapError(f"a chunk claims to hold {claimed:,} bytes")


def _damaged(path: Path, error: BaseException, offset: int) -> LogError:
    if isinstance(error, UnsupportedCompressionError):
        return LogError(f"{error}.", where=str(path), todo="Install the package that reads it.")
    if isinstance(error, CRCValidationError):
        what = f"a check sum does not match in the {type(error.record).__name__} record"
    else:
        what = f"a record cannot be read ({type(error).__name__}: {error})"
    return LogError(
        f"the log is damaged: {what}, near byte {offset:,}.",
        where=str(path),
        todo="Nothing of it was used. Copy it again, or write a whole file from what is left with `mcap recover` "
        "of the MCAP command line tool, and use that.",
    )
