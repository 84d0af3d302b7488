"""The random numbers of training: one named stream for each purpose of each seed, drawn in chunks."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.streams import stream

Array = NDArray[np.float64]

CHUNK = 500
"""Steps drawn at once; a stream gives the same numbers in any chunk size."""


class Draws(NamedTuple):
    """Numbers for a stretch of steps; leading axes [steps, seeds]. Smoothing has no rows where none is wanted."""

    start: Array
    exploration: Array
    uniform_action: Array
    batch: Array
    smoothing: NDArray[np.float32]
    force: Array | None


PURPOSES = ("start", "exploration", "uniform action", "batch", "smoothing", "force")


class DrawStreams:
    """The generators of a block of seeds. An arm of a study uses the same ones as any other: runs are paired.

    `smoothed`: whether the algorithm smooths its targets; what nobody looks at is not drawn.
    """

    def __init__(
        self, seeds: list[int], batch_size: int, plant_steps: int, force_std_n: float, *, smoothed: bool = True
    ) -> None:
        self._batch_size, self._plant_steps, self._force_std_n = batch_size, plant_steps, force_std_n
        self._smoothing_rows = batch_size if smoothed else 0
        self._of = {name: [stream(seed, name) for seed in seeds] for name in PURPOSES}

    def draw(self, steps: int) -> Draws:
        """Draw the numbers of the next `steps` steps of every seed."""

        def each(name: str, shape: tuple[int, ...], kind: str) -> Array:
            if kind == "uniform":
                parts = [rng.random((steps, *shape)) for rng in self._of[name]]
            else:
                parts = [rng.standard_normal((steps, *shape)) for rng in self._of[name]]
            return np.stack(parts, axis=1) if len(parts) > 1 else parts[0][:, None]  # one seed needs no copy

        force = None
        if self._force_std_n:
            force = self._force_std_n * each("force", (self._plant_steps,), "normal").swapaxes(1, 2)
        return Draws(
            start=each("start", (), "uniform"),
            exploration=each("exploration", (), "normal"),
            uniform_action=2 * each("uniform action", (), "uniform") - 1,
            batch=each("batch", (self._batch_size,), "uniform"),
            smoothing=each("smoothing", (self._smoothing_rows,), "normal").astype(np.float32),
            force=force,
        )

    def state(self) -> NDArray[np.uint64]:
        """Where the generators are: [purposes, seeds, 4]: PCG64's state and increment in halves, high first."""
        return np.array([[_words(rng) for rng in self._of[name]] for name in PURPOSES], dtype=np.uint64)

    def restore(self, state: NDArray[np.uint64]) -> None:
        """Put the generators where `state` was taken."""
        for name, of_seeds in zip(PURPOSES, state, strict=True):
            for rng, words in zip(self._of[name], of_seeds, strict=True):
                high, low, step_high, step_low = (int(word) for word in words)
                rng.bit_generator.state = {
                    "bit_generator": "PCG64",
                    "state": {"state": high << 64 | low, "inc": step_high << 64 | step_low},
                    "has_uint32": 0,  # only draws of 32 bits leave a half behind, and there are none
                    "uinteger": 0,
                }


def _words(rng: np.random.Generator) -> list[int]:
    state: Any = rng.bit_generator.state["state"]
    mask = (1 << 64) - 1
    return [state["state"] >> 64, state["state"] & mask, state["inc"] >> 64, state["inc"] & mask]
