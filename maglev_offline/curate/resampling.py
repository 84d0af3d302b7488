"""Bootstrap over logs, or over stretches of them: neighbouring rows are no independent witnesses."""

from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]
Units = NDArray[np.int64]
Interval = tuple[float, float]

RESAMPLES = 1000
CONFIDENCE = 0.95

LEAST_LOGS = 8
"""From so many logs on, whole logs are resampled; of fewer, stretches of them, since few logs give no interval."""

BLOCK_S = 10.0
"""Length of a stretch. The slowest loop here, the paper's PID, forgets in 6 s, so stretches are all but independent."""

LEAST_ROWS, LEAST_UNITS = 30, 6
"""A part of the rows (a cell, a log) is judged from so many rows and units on; below, its interval means nothing."""


def units_of(table: pd.DataFrame) -> tuple[Literal["logs", "stretches"], Units]:
    """What is resampled, and the unit of each row [n]: its log, or a stretch of `BLOCK_S` of its segment."""
    if table["log_id"].nunique() >= LEAST_LOGS:
        return "logs", pd.factorize(table["log_id"])[0].astype(np.int64)
    return "stretches", stretches_of(table)


def stretches_of(table: pd.DataFrame) -> Units:
    """The stretch of `BLOCK_S` of its segment that each row lies in, counted from 0; shape [n]."""
    segment = table.groupby(["log_id", "point", "segment"], sort=False)
    since_s = (table["t"] - segment["t"].transform("min")).dt.total_seconds().to_numpy()
    keys = pd.DataFrame({"segment": segment.ngroup().to_numpy(), "stretch": np.floor(since_s / BLOCK_S)})
    return keys.groupby(["segment", "stretch"], sort=False).ngroup().to_numpy().astype(np.int64)


def resamples(rng: np.random.Generator, units: int) -> NDArray[np.int64]:
    """How often each unit comes in each resample, shape [RESAMPLES, units]."""
    return rng.multinomial(units, np.full(units, 1 / units), RESAMPLES)


def interval(values: Array) -> Interval | None:
    """The percentile interval of a statistic over resamples [r]; None where one of them has no value."""
    if not np.isfinite(values).all():
        return None
    low, high = np.quantile(values, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def interval_of_part(values: Array) -> Interval | None:
    """The same for a part of the rows; resamples that happen to hold none of it say nothing, and are left out."""
    values = values[np.isfinite(values)]
    return interval(values) if len(values) else None


def rows_and_units(part: Units, unit: Units, parts: int) -> tuple[Units, Units]:
    """How many rows and how many units each part has, both [parts]; `part` and `unit` [n] say where each row lies."""
    pairs = np.unique(np.stack([part, unit], axis=1), axis=0)
    return np.bincount(part, minlength=parts), np.bincount(pairs[:, 0], minlength=parts)
