"""Checkpoints of an unfinished block: an append-only log of replay rows, and a small file with everything else.

The log is in place and on the disk before the state that counts it, and the state takes the place of the one before in
one step, so that at any instant there is a whole checkpoint or none. Rows beyond the count belong to a checkpoint that
was never finished, and are cut off.
"""

import fcntl
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from maglev_offline.replay.buffer import WIDTH

Arrays = dict[str, NDArray[Any]]

ROWS, STATE, LOCK = "rows.f32", "state.safetensors", "lock"


class Unusable(Exception):
    """A checkpoint that cannot be gone on from; the text says why."""


class Saved(NamedTuple):
    """A checkpoint as it was read: `rows` [n, seeds, WIDTH], the last of all that were added."""

    step: int
    state: Arrays
    rows: NDArray[np.float32]


class Checkpoint:
    """The checkpoint of one block in `folder`; `mark` stands for all that its bytes depend on, versions too."""

    def __init__(self, folder: Path, mark: str, seeds: int) -> None:
        self.folder, self.mark, self.seeds = folder, mark, seeds
        self._rows = self._crc = 0

    @contextmanager
    def held(self) -> Iterator[None]:
        """Be the only one who writes here. A worker that a killed command left behind ends by itself: wait for it."""
        while True:
            self.folder.mkdir(parents=True, exist_ok=True)
            with (self.folder / LOCK).open("w") as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                if _is_at(self.folder / LOCK, file):  # else it was removed while we waited
                    yield
                    return

    def save(self, step: int, state: Mapping[str, NDArray[Any]], new_rows: NDArray[np.float32]) -> None:
        """Keep the state at `step` and the rows [n, seeds, WIDTH] that were added since the last time."""
        data = np.ascontiguousarray(new_rows, dtype="<f4").tobytes()
        with (self.folder / ROWS).open("ab") as file:
            file.truncate(self._rows * self._row_bytes)
            file.write(data)
            _flush(file)
        self._rows, self._crc = self._rows + len(new_rows), crc32(data, self._crc)
        arrays = {name: np.asarray(value, order="C") for name, value in state.items()}
        about = {"mark": self.mark, "step": step, "rows": self._rows, "rows_crc": self._crc, "crc": _crc_of(arrays)}
        about["about_crc"] = _crc_of_about(step, self._rows)
        draft = self.folder / f".{STATE}.draft"
        with draft.open("wb") as file:
            file.write(save(arrays, {name: str(value) for name, value in about.items()}))
            _flush(file)
        draft.replace(self.folder / STATE)
        handle = os.open(self.folder, os.O_RDONLY)
        os.fsync(handle)
        os.close(handle)

    def load(self, most_rows: int) -> Saved | None:
        """Read the checkpoint, with at most so many of its last rows; None: there is none.

        Raises
        ------
        Unusable: it is damaged, or it belongs to other settings, another engine or other versions.
        """
        about, state = self._read_state()
        if about is None:
            return None
        if about.get("mark") != self.mark:
            raise Unusable("it was made with other settings, inputs, versions or another engine")
        try:
            step, rows, rows_crc, crc = (int(about[name]) for name in ("step", "rows", "rows_crc", "crc"))
        except (KeyError, ValueError):
            raise Unusable("it is damaged") from None
        both = str(_crc_of_about(step, rows))
        if _crc_of(state) != crc or about.get("about_crc", both) != both:  # an older version has none of these two
            raise Unusable(f"it is damaged: {STATE} is not what was written")
        data = self._read_rows(rows, rows_crc)
        self._rows, self._crc = rows, rows_crc
        return Saved(step, state, data[-most_rows:])

    def is_ours(self) -> bool:
        """Whether there is a checkpoint of this very training, whatever state it is in."""
        try:
            about, _ = self._read_state()
        except Unusable:
            return False
        return about is not None and about.get("mark") == self.mark

    def remove(self) -> None:
        """Forget it."""
        shutil.rmtree(self.folder, ignore_errors=True)

    @property
    def _row_bytes(self) -> int:
        return self.seeds * WIDTH * 4

    def _read_state(self) -> tuple[dict[str, str] | None, Arrays]:
        path = self.folder / STATE
        if not path.is_file():
            return None, {}
        try:
            with safe_open(path, framework="numpy") as file:
                return file.metadata() or {}, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (OSError, SafetensorError, KeyError, ValueError) as error:
            raise Unusable(f"it is damaged: {STATE} cannot be read ({error})") from None

    def _read_rows(self, rows: int, crc: int) -> NDArray[np.float32]:
        try:
            with (self.folder / ROWS).open("rb") as file:
                there = os.fstat(file.fileno()).st_size
                # The number may be anything: it is no reason to ask for the memory.
                data = file.read(rows * self._row_bytes) if 0 <= rows * self._row_bytes <= there else b""
        except OSError as error:
            raise Unusable(f"it is damaged: {ROWS} cannot be read ({error})") from None
        if len(data) != rows * self._row_bytes or crc32(data) != crc:
            raise Unusable(f"it is damaged: {ROWS} is not what was written")
        return np.frombuffer(data, dtype="<f4").reshape(rows, self.seeds, WIDTH)


def _is_at(path: Path, file: Any) -> bool:
    return path.exists() and path.stat().st_ino == os.fstat(file.fileno()).st_ino


def _flush(file: Any) -> None:
    file.flush()
    os.fsync(file.fileno())


def _crc_of_about(step: int, rows: int) -> int:
    return crc32(f"{step} {rows}".encode())


def _crc_of(arrays: Arrays) -> int:
    crc = 0
    for name in sorted(arrays):
        value = arrays[name]
        crc = crc32(f"{name} {value.dtype} {value.shape}".encode(), crc)
        crc = crc32(value.tobytes(), crc)
    return crc
