"""Progress of worker processes: a file that they append to, read by a thread of the command."""

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maglev_offline.progress import Ticker


class Orphaned(Exception):
    """The command that a worker worked for is gone; nobody waits for the result."""


class FileTicker:
    """Counts into the file of `tick_file`, from any process, as long as the command `owner` (a process id) lives."""

    def __init__(self, path: Path, owner: int) -> None:
        self.path, self.owner = path, owner

    def __call__(self, done: int, /) -> None:
        """Add `done` units.

        Raises
        ------
        Orphaned: the command was killed. Its next run must find no one at work on its checkpoints.
        """
        if self.owner not in (os.getpid(), os.getppid()):
            raise Orphaned(f"process {self.owner} is gone")
        with self.path.open("ab") as file:
            file.write(done.to_bytes(8, "little"))


@contextmanager
def tick_file(tick: Ticker) -> Iterator[FileTicker]:
    """Pass on to `tick` what any process counts into the file: works across any kind of process."""
    handle, name = tempfile.mkstemp(prefix="maglev-offline-ticks-")
    os.close(handle)
    path, stop = Path(name), threading.Event()

    def watch() -> None:
        offset = 0
        while True:
            last_round = stop.wait(0.5)
            with path.open("rb") as file:
                file.seek(offset)
                data = file.read()
            whole = len(data) // 8 * 8
            for at in range(0, whole, 8):
                tick(int.from_bytes(data[at : at + 8], "little"))
            offset += whole
            if last_round:
                return

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield FileTicker(path, os.getpid())
    finally:
        stop.set()
        thread.join()
        path.unlink(missing_ok=True)
