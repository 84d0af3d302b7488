"""Which rows of the samples can be fitted: contiguous free stretches, finite, with something that moves."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.errors import InputError

Array = NDArray[np.float64]

SIGNALS = ("gap_m", "current_a", "voltage_v")


@dataclass(frozen=True)
class Stretch:
    """Rows of one segment without contact, one period apart; the signals have shape [n], SI units.

    `first_step` is the step of the first row in its segment.
    """

    log_id: str
    point: str
    segment: int
    first_step: int
    gap_m: Array
    current_a: Array
    voltage_v: Array

    def __len__(self) -> int:
        return len(self.gap_m)


@dataclass(frozen=True)
class FreeRows:
    """The stretches of all logs, their common period, and how many rows were left out by reason."""

    stretches: tuple[Stretch, ...]
    period_s: float
    left_out: dict[str, int]

    @property
    def rows(self) -> int:
        """Rows in all stretches."""
        return sum(len(s) for s in self.stretches)


def free_rows(samples: pd.DataFrame, where: str = "samples") -> FreeRows:
    """Cut samples into stretches; a segment that a contact or a row that is left out interrupts gives several.

    Raises
    ------
    InputError: no rows, a value that is not finite, only contacts, logs of different periods, or nothing that moves.
    """
    if samples.empty:
        raise InputError("there are no samples (0 rows).", where=where, todo="Ingest logs first.")
    _finite(samples, where)
    contact = samples["contact"].to_numpy(dtype=bool)
    if contact.all():
        raise InputError(
            f"all {len(samples):,} rows are in contact with a stop, and a magnet that touches moves by no law of "
            "the plant.",
            where=where,
            todo="Check plant.gap_min_m and plant.gap_max_m against the units of the gap.",
        )
    free = samples[~contact].reset_index(drop=True)
    period = _period(samples, where)
    found = tuple(_stretches(free))
    _moves(free, where)
    return FreeRows(found, period, {"contact": int(contact.sum())})


def _stretches(free: pd.DataFrame) -> list[Stretch]:
    key = free[["log_id", "point", "segment"]]
    step = free["step"].to_numpy()
    new = (key != key.shift()).any(axis=1).to_numpy() | (np.diff(step, prepend=step[0] - 1) != 1)
    starts = np.flatnonzero(new)
    found = []
    for start, stop in zip(starts, np.append(starts[1:], len(free)), strict=True):
        part, head = free.iloc[start:stop], free.iloc[start]
        gap, current, voltage = (part[name].to_numpy(dtype=np.float64) for name in SIGNALS)
        found.append(
            Stretch(
                str(head["log_id"]), str(head["point"]), int(head["segment"]), int(head["step"]), gap, current, voltage
            )
        )
    return found


def _finite(samples: pd.DataFrame, where: str) -> None:
    for name in SIGNALS:
        bad = ~np.isfinite(samples[name].to_numpy(dtype=np.float64))
        if bad.any():
            raise InputError(
                f"{name} is not finite in {int(bad.sum()):,} of {len(bad):,} rows (the first is row "
                f"{int(np.flatnonzero(bad)[0])}).",
                where=where,
                todo="Ingest the logs again; ingestion quarantines such messages.",
            )


def _period(samples: pd.DataFrame, where: str) -> float:
    """Period of the grid in seconds, the same in all logs."""
    t_ns = samples["t"].astype("int64").to_numpy()
    key = samples[["log_id", "point", "segment"]]
    together = ~(key != key.shift()).any(axis=1).to_numpy()[1:] & (np.diff(samples["step"].to_numpy()) == 1)
    periods = np.unique(np.diff(t_ns)[together])
    if len(periods) == 0:
        raise InputError(
            f"no two of {len(samples):,} rows follow each other.", where=where, todo="Check ingest.grid_ms."
        )
    # The grid is one of whole nanoseconds; anything further apart is another grid.
    if periods[-1] - periods[0] > 1000 or periods[0] <= 0:
        raise InputError(
            f"the rows are {periods[0] / 1e6:g} to {periods[-1] / 1e6:g} ms apart, and one fit needs one period.",
            where=where,
            todo="Ingest all logs with the same ingest.grid_ms.",
        )
    return float(periods[len(periods) // 2]) / 1e9


def _moves(free: pd.DataFrame, where: str) -> None:
    level = {name: free[name].to_numpy(dtype=np.float64) for name in SIGNALS}
    still = [name for name, values in level.items() if np.ptp(values) <= 1e-9 * max(float(np.abs(values).max()), 1e-9)]
    if "current_a" in still:
        shown = ", ".join(f"{name} = {level[name][0]:g}" for name in still)
        raise InputError(
            f"no excitation: {shown} in all {len(free):,} free rows, so no parameter shows in them.",
            where=where,
            todo="Use a recording in which the set-point or the load changes.",
        )
