"""How fast things turn: the plant's fastest mode, and the strongest swing of a signal on the grid."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

_ROWS = 64
_MOST_WINDOWS = 32


@lru_cache(maxsize=8)
def fastest_rad_s(plant: Plant) -> float:
    """Magnitude of the fastest open-loop pole about the set-point, in rad/s."""
    return float(np.abs(linearise(plant).poles).max())


def strongest_swing(values: NDArray[np.float64], segment: NDArray[np.int32]) -> float:
    """Frequency of the peak of the mean spectrum over windows of 64 rows, in rad per row; 0 where there is no window.

    Windows lie within segments, have their mean and slope taken out and a Hann taper. The lowest two bins are left out:
    they hold slow motion, which no time base is too coarse for.
    """
    first = np.concatenate([[0], np.flatnonzero(np.diff(segment)) + 1])
    length = np.diff(np.append(first, len(segment)))
    windows = length // _ROWS
    if windows.sum() == 0:
        return 0.0
    within = np.arange(int(windows.sum())) - np.repeat(np.cumsum(windows) - windows, windows)
    starts = np.repeat(first, windows) + within * _ROWS
    starts = starts[:: max(len(starts) // _MOST_WINDOWS, 1)]
    part = values[starts[:, None] + np.arange(_ROWS)]
    part = part[np.isfinite(part).all(axis=1)]
    ramp = np.arange(_ROWS) - (_ROWS - 1) / 2
    part = part - part.mean(axis=1, keepdims=True)
    part = part - (part @ ramp / (ramp @ ramp))[:, None] * ramp
    power = np.mean(np.abs(np.fft.rfft(part * np.hanning(_ROWS), axis=1)) ** 2, axis=0) if len(part) else np.zeros(2)
    if power[2:].sum() == 0:
        return 0.0
    return float(2 + np.argmax(power[2:])) * 2 * np.pi / _ROWS
