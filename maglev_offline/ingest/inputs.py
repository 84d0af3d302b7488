"""Which files a command was asked to read: paths, folders, patterns and addresses become a sorted list of logs."""

import glob
import re
from collections.abc import Iterable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from maglev_offline.errors import InputError
from maglev_offline.filesystems import Where, below, in_words, is_address, local_path, open_address, shown

__all__ = ["Where", "find_logs"]

_MAGIC = re.compile(r"[*\[]")  # in an address, a `?` begins the options of the store


def find_logs(asked: Iterable[str], relative_to: Path | None = None) -> list[Where]:
    """Resolve paths, folders (their `*.mcap`), patterns and addresses to files, each once, in sorted order.

    A local file comes as a Path (also one that was named as `file:///...`), any other as its address; paths come first.
    In an address, `*`, `**` and `[ab]` are wildcards, `?` is none. `relative_to`: the folder that relative paths start
    from; default is the current one.

    Raises
    ------
    InputError: a folder or a pattern holds no log, nothing was asked for, or a store cannot be listed.
    """
    found: dict[Path, Path] = {}
    addresses: set[str] = set()
    for text in asked:
        local = local_path(text) if is_address(text) else None
        if is_address(text) and local is None:
            addresses.update(_in_store(text))
            continue
        for match in _local(text if local is None else str(local), relative_to):
            found.setdefault(match.resolve(), match)
    if not found and not addresses:
        raise InputError(
            "no logs were named.",
            where="logs",
            todo='Name them on the command line, or as `logs = ["../data_raw/*.mcap"]` in the recipe.',
        )
    return [*sorted(found.values()), *sorted(addresses)]


def _local(text: str, relative_to: Path | None) -> list[Path]:
    path = Path(text) if relative_to is None else relative_to / text
    if path.is_dir():
        matches = sorted(path.glob("*.mcap"))
    elif path.exists():
        matches = [path]
    elif glob.has_magic(text):
        matches = _matches(text, relative_to)
    else:
        matches = [path]  # reading it will say that it is not there, and the others go on
    if not matches:
        raise _nothing(str(path))
    return matches


def _nothing(where: str) -> InputError:
    return InputError(
        "no MCAP file is there.",
        where=where,
        todo="Give paths of .mcap files, folders that hold them, or patterns such as logs/*.mcap.",
    )


def _matches(pattern: str, relative_to: Path | None) -> list[Path]:
    """Files that match a pattern, and the logs in folders that match it; only `pattern` itself holds wildcards."""
    if relative_to is not None:
        pattern = str(Path(glob.escape(str(relative_to))) / pattern)
    names = [Path(name) for name in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207 (may be absolute)
    return [log for path in names for log in (sorted(path.glob("*.mcap")) if path.is_dir() else [path])]


def _in_store(address: str) -> list[str]:
    """Addresses of the logs that an address names: of one file, of a folder, or of a pattern."""
    base, parts = _fixed_part(address)
    store, home = open_address(base)
    with in_words(base):
        if not parts:
            from pyarrow import fs

            kind = store.get_file_info(home).type
            if kind != fs.FileType.Directory:  # what is not there is told by whoever reads it, and the others go on
                return [address]
            parts = ["*.mcap"]
        found = [
            relative for relative in _listed(store, home, deep=len(parts) > 1) if _fits(relative.split("/"), parts)
        ]
    if not found:
        raise _nothing(shown(address))
    return [below(base, quote(relative)) for relative in found]


def _fixed_part(address: str) -> tuple[str, list[str]]:
    """The address up to the first part with a wildcard, and the parts from there on; options stay with the address."""
    scheme, rest = address.split("://", 1)
    path, question, options = rest.partition("?")
    parts = path.split("/")
    first = next((n for n, part in enumerate(parts) if _MAGIC.search(part)), len(parts))
    if first == 0:
        raise InputError("the name of a bucket holds no wildcard.", where=shown(address), todo="Name the bucket.")
    fixed = "/".join(parts[:first])
    return f"{scheme}://{fixed}{question}{options}", [unquote(part) for part in parts[first:] if part]


def _listed(store: Any, home: str, *, deep: bool) -> list[str]:
    """Paths of the files in a folder, relative to it; with `deep`, of those in its folders too."""
    from pyarrow import fs

    entries = store.get_file_info(fs.FileSelector(home, recursive=deep))
    length = len(home.rstrip("/")) + 1
    return [entry.path[length:] for entry in entries if entry.type == fs.FileType.File]


def _fits(names: list[str], pattern: list[str]) -> bool:
    """Whether the parts of a path match those of a pattern; `**` stands for any number of folders, also for none."""
    if not pattern:
        return not names
    if pattern[0] == "**":
        rest = pattern[1:] or ["*"]
        return any(_fits(names[skipped:], rest) for skipped in range(len(names)))
    return bool(names) and fnmatchcase(names[0], pattern[0]) and _fits(names[1:], pattern[1:])
