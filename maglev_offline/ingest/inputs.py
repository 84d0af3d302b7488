"""Which files a command was asked to read: paths, folders and patterns become a sorted list of logs."""

import glob
from collections.abc import Iterable
from pathlib import Path

from maglev_offline.errors import InputError


def find_logs(asked: Iterable[str], relative_to: Path | None = None) -> list[Path]:
    """Resolve paths, folders (their `*.mcap`) and patterns to files, each once, in sorted order.

    `relative_to`: the folder that relative paths start from; default is the current one.

    Raises
    ------
    InputError: a folder or a pattern holds no log, or nothing was asked for.
    """
    found: dict[Path, Path] = {}
    for text in asked:
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
            raise InputError(
                "no MCAP file is there.",
                where=str(path),
                todo="Give paths of .mcap files, folders that hold them, or patterns such as logs/*.mcap.",
            )
        for match in matches:
            found.setdefault(match.resolve(), match)
    if not found:
        raise InputError(
            "no logs were named.",
            where="logs",
            todo='Name them on the command line, or as `logs = ["../data_raw/*.mcap"]` in the recipe.',
        )
    return sorted(found.values())


def _matches(pattern: str, relative_to: Path | None) -> list[Path]:
    """Files that match a pattern, and the logs in folders that match it; only `pattern` itself holds wildcards."""
    if relative_to is not None:
        pattern = str(Path(glob.escape(str(relative_to))) / pattern)
    names = [Path(name) for name in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207 (may be absolute)
    return [log for path in names for log in (sorted(path.glob("*.mcap")) if path.is_dir() else [path])]
