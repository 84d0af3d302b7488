"""Where a file lies: a local path, or an address such as `s3://bucket/logs/a.mcap`, read through pyarrow.

pyarrow.fs is imported only where an address is used. Failures of stores are told in plain words.
"""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from maglev_offline.errors import InputError, MaglevOfflineError

Where = Path | str
"""A local file as a Path, anything else as its address (a str)."""

GOOGLE_TRIES_S = 20

LONGEST_REASON = 300
"""Characters of a store's own words that people are shown."""

# Two letters at least, so that a Windows drive is none; no "::", with which fsspec chains stores.
_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")

_TODO = "Check the address, the credentials (for S3: AWS_ACCESS_KEY_ID, AWS_PROFILE) and the network."

_WORDS = (
    (r"NO_SUCH_BUCKET|no ?such ?bucket|bucket '[^']*' not found", "there is no such bucket"),
    (
        r"ACCESS_DENIED|FORBIDDEN|INVALID_ACCESS_KEY|SIGNATURE_DOES_NOT_MATCH|UNAUTHENTICATED|PERMISSION_DENIED"
        r"|credential|anonymous|authenticat|access token|\b40[13]\b|denied",
        "the store refuses access: no credentials, or none that suffice",
    ),
    (r"NETWORK_CONNECTION|resolve host|timed? ?out|connect", "the store cannot be reached"),
    (r"RESOURCE_NOT_FOUND|NO_SUCH_KEY|not found|does not exist|no such file|\b404\b", "it is not there"),
)


def write_whole(path: Path, content: bytes) -> None:
    """Write a local file that appears under its name only when it is whole; raises OSError as writing does.

    A link is followed, and what is there and no file (a pipe, `/dev/stdout`) is written into. The draft has one name,
    so that the same command after one that was killed leaves none behind.
    """
    if path.exists() and not path.is_file():
        path.write_bytes(content)
        return
    place = path.resolve()
    draft = place.with_name(f".{place.name}.draft")
    try:
        draft.write_bytes(content)
        if place.exists():
            shutil.copymode(place, draft)
        draft.replace(place)
    except OSError as error:
        error.filename, error.filename2 = str(path), None  # the name that was given
        raise
    finally:
        draft.unlink(missing_ok=True)


def is_address(text: str) -> bool:
    """Whether a text is an address and not a path."""
    return _ADDRESS.match(text) is not None


def local_path(address: str) -> Path | None:
    """The path that a `file://` address stands for; None for any other address.

    Raises
    ------
    InputError: it names another machine, or is not absolute.
    """
    if not address.lower().startswith("file://"):
        return None
    host, slash, path = address[len("file://") :].partition("/")
    if host not in ("", "localhost") or not slash:
        raise InputError(
            "a file:// address holds three slashes and an absolute path.",
            where=address,
            todo="Write it like file:///data/logs.",
        )
    return Path("/" + unquote(path))


def shown(where: Where) -> str:
    """Name for people: an address without a password, a key or options in it."""
    if isinstance(where, Path) or not is_address(where):
        return str(where)
    return without_keys(where).split("?", 1)[0]


def without_keys(text: str) -> str:
    """A text with the keys taken out of the address in it: `s3://key:secret@bucket` becomes `s3://bucket`.

    A secret that was not encoded may hold slashes, so whatever lies between a colon and the last @ may be one.
    """
    return re.sub(r"://[^@?\s]*:[^?\s]*@", "://", text)


def name_of(where: Where) -> str:
    """Name of the file alone, as text that can be written anywhere: a file may have any bytes for its name."""
    name = where.name if isinstance(where, Path) else unquote(shown(where).rstrip("/").rpartition("/")[2])
    return name.encode(errors="backslashreplace").decode()


def below(address: str, relative: str) -> str:
    """Address of what lies below another; options behind a `?` stay behind it."""
    base, question, options = address.partition("?")
    return f"{base.rstrip('/')}/{relative}{question}{options}"


def open_address(address: str) -> tuple[Any, str]:
    """File system of an address, and the path in it; pyarrow's own, or one of fsspec where that knows more.

    Raises
    ------
    InputError: nothing can open such an address.
    """
    with in_words(address):
        import pyarrow as pa
        from pyarrow import fs

        try:
            found, path = fs.FileSystem.from_uri(_patient(address))
        except pa.ArrowInvalid as error:
            if "Unrecognized filesystem" not in str(error):
                raise
            return _of_fsspec(address)
        return found, path
    raise AssertionError("in_words swallows nothing")


def _patient(address: str) -> str:
    """Google's client tries for 15 minutes where nobody says how long."""
    if not address.startswith(("gs://", "gcs://")) or "retry_limit_seconds=" in address:
        return address
    return f"{address}{'&' if '?' in address else '?'}retry_limit_seconds={GOOGLE_TRIES_S}"


def _of_fsspec(address: str) -> tuple[Any, str]:
    scheme = address.split("://", 1)[0]
    unknown = InputError(
        f"there is nothing here that opens {scheme}:// addresses.",
        where=shown(address),
        todo="Give a path, or an address such as s3://bucket/folder, gs://, abfs:// or file:///.",
    )
    try:
        from fsspec.core import url_to_fs  # type: ignore[import-untyped]
        from pyarrow import fs

        if "::" in address:
            raise unknown
        found, path = url_to_fs(address)
    except (ImportError, ValueError):
        raise unknown from None
    if not scheme.startswith("http"):  # pyarrow decodes %20 and its like, and fsspec leaves that to the store
        path = unquote(path)
    return fs.PyFileSystem(fs.FSSpecHandler(found)), path


@contextmanager
def in_words(where: Where) -> Iterator[None]:
    """Tell the failures of a store as errors of input, in plain words and without its stack of causes.

    Raises
    ------
    InputError: the body failed to open, list, read or write `where`.
    """
    try:
        yield
    except MaglevOfflineError:
        raise
    except FileNotFoundError:
        raise InputError("it is not there.", where=shown(where), todo=_TODO) from None
    except Exception as error:  # every store has exceptions of its own
        text = _first_line(str(error)) or type(error).__name__
        words = next((w for pattern, w in _WORDS if re.search(pattern, text, re.IGNORECASE)), "it cannot be used")
        raise InputError(f"{words} ({text}).", where=shown(where), todo=_TODO) from None


def _first_line(text: str) -> str:
    """The first line, no longer than people read, without the secrets that an address may hold."""
    line = without_keys(text.strip().split("\n", 1)[0]).rstrip(".")
    return line if len(line) <= LONGEST_REASON else f"{line[:LONGEST_REASON]}..."
