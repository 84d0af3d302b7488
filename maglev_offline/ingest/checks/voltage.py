"""Which resistance the logged voltage asks for: u = R i + d/dt(L(x) i), integrated over windows."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.checks.settings import CheckSettings
from maglev_offline.ingest.median import median
from maglev_offline.ingest.points import PointSamples
from maglev_offline.physics.dynamics import inductance
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Asked(NamedTuple):
    """The resistance that fits with its 95 % interval, how much of the mean voltage the declared one explains."""

    resistance_ohm: float
    low_ohm: float
    high_ohm: float
    share_explained: float
    windows: int


def resistance_of_windows(
    samples: PointSamples, plant: Plant, period_s: float, settings: CheckSettings
) -> Asked | None:
    """Integrate over windows, so that only the ends of the flux L(x) i matter; None with fewer than 5 of them.

    Each window within one segment gives a resistance; their median is the answer, its interval by the median of the
    distances from it. Windows with next to no current say nothing and are left out.
    """
    gap, current, voltage = (samples.values[name] for name in ("gap_m", "current_a", "voltage_v"))
    rows = max(settings.window_rows, int(np.ceil(settings.window_s / period_s)))
    starts = _window_starts(samples.segment, rows)
    if len(starts) < 5:
        return None
    stops = starts + rows
    # A gap that its sensor puts above the upper stop would make the inductance infinite.
    flux = [inductance(plant, np.maximum(gap[ends], plant.gap_min_m)) * current[ends] for ends in (starts, stops)]
    volt_seconds, amp_seconds = (_trapezoid(signal, starts, stops) * period_s for signal in (voltage, current))
    rising = flux[1] - flux[0]
    usable = amp_seconds > 0.1 * plant.equilibrium().current_a * rows * period_s
    usable &= np.isfinite(volt_seconds) & np.isfinite(rising)
    if np.count_nonzero(usable) < 5:
        return None
    volt_seconds, amp_seconds, rising = volt_seconds[usable], amp_seconds[usable], rising[usable]
    each = (volt_seconds - rising) / amp_seconds
    middle = median(each)
    # 1.4826 MAD is the standard deviation of normal values, 1.2533 / sqrt(n) of it that of their median.
    half = 1.96 * 1.2533 * 1.4826 * median(np.abs(each - middle)) / np.sqrt(len(each))
    total = float(volt_seconds.sum())
    explained = plant.resistance_ohm * float(amp_seconds.sum()) + float(rising.sum())
    return Asked(middle, middle - half, middle + half, explained / total if total else 0.0, len(each))


def _window_starts(segment: NDArray[np.int32], rows: int) -> Index:
    """First rows of windows of `rows` steps, one after the other within each segment."""
    first = np.concatenate([[0], np.flatnonzero(np.diff(segment)) + 1])
    length = np.diff(np.append(first, len(segment)))
    windows = (length - 1) // rows
    within = np.arange(int(windows.sum())) - np.repeat(np.cumsum(windows) - windows, windows)
    starts: Index = np.repeat(first, windows) + within * rows
    return starts


def _trapezoid(signal: Array, starts: Index, stops: Index) -> Array:
    """Integral of rows `starts` to `stops` by the trapezoidal rule, in units of one step."""
    sums = np.add.reduceat(signal, np.column_stack([starts, stops]).ravel())[::2]
    integral: Array = sums + 0.5 * (signal[stops] - signal[starts])
    return integral
