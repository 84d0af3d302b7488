"""Samples as the smoother takes them: chains of uniform steps without contact, and what is measured at each sample."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SIGNALS = ("gap_m", "gap_velocity_m_s", "current_a", "voltage_v")
ORIGINS = ("gap_origin", "gap_velocity_origin", "current_origin", "voltage_origin")


@dataclass(frozen=True)
class Tracks:
    """n samples in chains: within a chain they are `period_s` apart.

    `row` [n]: which row of the samples table; `chain` [n]: ascending numbers from 0; `value` [n, 4] in the order of
    `SIGNALS`, the velocity NaN where it was not logged; `moved` [n, 4]: the value is not of the instant itself, but
    was moved to it; `bridged` [n, 4]: it stands for a message that is missing, and says nothing (a loop that turns by
    pi from sample to sample is nowhere near the line between the two beside it); `set_point_m` [n].
    """

    row: Index
    chain: Index
    value: Array
    moved: NDArray[np.bool_]
    bridged: NDArray[np.bool_]
    set_point_m: Array
    period_s: float

    def __len__(self) -> int:
        return len(self.row)

    @cached_property
    def start(self) -> Index:
        """Where each chain starts, [chains]."""
        return np.flatnonzero(np.diff(self.chain, prepend=-1)).astype(np.int64)

    @cached_property
    def length(self) -> Index:
        """How many samples each chain has, [chains]."""
        return np.diff(np.append(self.start, len(self.row)))

    @cached_property
    def inner(self) -> Index:
        """The samples that another follows in their chain: the interval k is from `inner[k]` to the one after it."""
        return np.flatnonzero(np.append(np.diff(self.chain) == 0, False)[: len(self)]).astype(np.int64)

    def part(self, chains: Index, most: int | None = None, *, middle: bool = False) -> "Tracks":
        """Some of the chains, of each the first `most` samples, or those in the middle of it."""
        most = most or len(self)
        place = np.arange(len(self)) - self.start[self.chain] if len(self) else self.row
        if middle and len(self):
            place = place - np.maximum(self.length - most, 0)[self.chain] // 2
        keep = np.isin(self.chain, chains) & (place >= 0) & (place < most)
        number = np.unique(self.chain[keep], return_inverse=True)[1].astype(np.int64)
        set_point = self.set_point_m[keep]
        moved, bridged = self.moved[keep], self.bridged[keep]
        return Tracks(self.row[keep], number, self.value[keep], moved, bridged, set_point, self.period_s)


def tracks_of(samples: pd.DataFrame) -> list[Tracks]:
    """The chains of a table of samples that is in the order of `pairs.in_order`, by their period, shortest first.

    Samples in contact, or without a finite gap, current, voltage and set-point, end a chain and are in none.
    """
    value = samples[list(SIGNALS)].to_numpy(dtype=np.float64, copy=True)
    set_point = samples["set_point_m"].to_numpy(dtype=np.float64)
    usable = np.isfinite(value[:, [0, 2, 3]]).all(axis=1) & np.isfinite(set_point)
    usable &= ~samples["contact"].to_numpy(dtype=bool)
    value[(samples["gap_velocity_origin"] == "reconstructed").to_numpy(dtype=bool), 1] = np.nan
    moved, bridged = _origin_is_not(samples, "measured"), ~_origin_is_not(samples, "bridged")
    t = samples["t"].astype("int64").to_numpy()
    following = np.append(_together(samples), False)[: len(samples)]
    following &= usable & np.append(usable[1:], False)[: len(samples)]
    duration = np.append(np.diff(t), 0)[: len(samples)]
    found = []
    for period in np.unique(duration[following]):
        begins = following & (duration == period)
        member = np.flatnonzero(begins | np.append(False, begins[:-1]))
        chain = np.cumsum(~np.append(False, begins[:-1])[member]) - 1
        period_s, at = float(period) / _units_a_second(samples), set_point[member]
        found.append(Tracks(member, chain, value[member], moved[member], bridged[member], at, period_s))
    return found


def _origin_is_not(samples: pd.DataFrame, origin: str) -> NDArray[np.bool_]:
    """Of each signal [n, 4]; a table without origins was measured."""
    there = [samples[o] if o in samples else pd.Series("measured", index=samples.index) for o in ORIGINS]
    return np.stack([(one != origin).to_numpy(bool) for one in there], axis=1)


def _together(samples: pd.DataFrame) -> NDArray[np.bool_]:
    key = samples[["log_id", "point", "segment"]]
    same: NDArray[np.bool_] = (key.iloc[:-1].to_numpy() == key.iloc[1:].to_numpy()).all(axis=1)
    joined: NDArray[np.bool_] = same & (np.diff(samples["step"].to_numpy()) == 1)
    return joined


def _units_a_second(samples: pd.DataFrame) -> float:
    return float(pd.Timedelta(seconds=1) / pd.Timedelta(1, unit=samples["t"].dt.unit))
