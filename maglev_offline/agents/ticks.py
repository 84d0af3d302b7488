"""Progress of worker processes: files that they append to, read by a thread of the command."""

import fcntl
import os
import secrets
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maglev_offline.progress import Ticker

OWNER = "owner"
"""The file that the command holds a lock on, which ends with it, on whatever machine it ends."""


class Orphaned(Exception):
    """The command that a worker worked for is gone; nobody waits for the result."""


class FileTicker:
    """Counts into the folder of `tick_files`, from any process that sees it, as long as the command lives.

    Each process appends to a file of its own: two machines that append to one overwrite each other on a network drive.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, done: int, /) -> None:
        """Add `done` units.

        Raises
        ------
        Orphaned: the command was killed. Its next run must find no one at work on its checkpoints.
        """
        if not _is_held(self.folder / OWNER):
            raise Orphaned(f"the command of {self.folder} is gone")
        mine = f"{os.uname().nodename}-{os.getpid()}-{threading.get_ident()}"
        with (self.folder / mine).open("ab") as file:
            file.write(done.to_bytes(8, "little"))


def _is_held(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except FileNotFoundError:
        return False
    return False


@contextmanager
def tick_files(tick: Ticker, shared: Path | None = None) -> Iterator[FileTicker]:
    """Pass on to `tick` what any process counts: works across any kind of process.

    `shared`: a folder that the workers of a cluster see; None where they are on this machine.
    """
    with _folder(shared) as folder:
        stop = threading.Event()
        thread = threading.Thread(target=_watch, args=(folder, tick, stop), daemon=True)
        with (folder / OWNER).open("w") as owner:
            fcntl.flock(owner, fcntl.LOCK_EX)
            thread.start()
            try:
                yield FileTicker(folder)
            finally:
                stop.set()
                thread.join()


@contextmanager
def _folder(shared: Path | None) -> Iterator[Path]:
    """A folder for the time being. What a killed command leaves in a workspace has a name that the next sweeps away."""
    home = Path(tempfile.mkdtemp()) if shared is None else shared / f".ticks.{secrets.token_hex(4)}.draft"
    home.mkdir(exist_ok=shared is None)
    try:
        yield home
    finally:
        shutil.rmtree(home, ignore_errors=True)  # a worker may be at its last step, and count it


def _watch(folder: Path, tick: Ticker, stop: threading.Event) -> None:
    read: dict[Path, int] = {}
    while True:
        last_round = stop.wait(0.5)
        for path in sorted(folder.iterdir()):
            with path.open("rb") as file:
                file.seek(read.get(path, 0))
                data = file.read()
            whole = len(data) // 8 * 8
            for at in range(0, whole, 8):
                tick(int.from_bytes(data[at : at + 8], "little"))
            read[path] = read.get(path, 0) + whole
        if last_round:
            return
