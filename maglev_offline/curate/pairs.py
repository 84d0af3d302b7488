"""Pairs of samples that follow each other in a segment: what every construction makes its rows from."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

PLACE = ("log_id", "point", "t", "segment", "step")
"""The columns that say where the first sample of a pair lies."""


@dataclass(frozen=True)
class Pairs:
    """Neighbouring samples, n pairs; deviations are from the equilibrium at the set-point of the first sample.

    `state` and `next_state` [n, 3] in the order of `mdp.STATE_NAMES`, `voltage_v` and `next_voltage_v` [n] (v = u -
    u_eq), `duration_s` [n], all in SI units. `touches`: the second sample is in contact with a stop.
    `velocity_logged`: both velocities were logged, not made from differences of the gap. `last`: the pair ends its
    segment. `place`: a table of the columns of `PLACE`, for the first sample. `samples`: the table they are of, in
    order, and `row` [n]: where the first sample is in it.
    """

    state: Array
    next_state: Array
    voltage_v: Array
    next_voltage_v: Array
    duration_s: Array
    touches: Mask
    velocity_logged: Mask
    last: Mask
    place: pd.DataFrame
    samples: pd.DataFrame
    row: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.duration_s)


def pairs_of(samples: pd.DataFrame, plant: Plant) -> Pairs:
    """Pair each sample with the next one of its segment; the order of the rows of `samples` does not matter."""
    samples = samples.sort_values(["log_id", "point", "segment", "step"], kind="stable", ignore_index=True)
    key = samples[["log_id", "point", "segment"]]
    joined = (key.iloc[:-1].to_numpy() == key.iloc[1:].to_numpy()).all(axis=1)
    joined &= np.diff(samples["step"].to_numpy()) == 1  # of a segment of which not all was drawn
    first = np.flatnonzero(joined)
    here, there = samples.iloc[first], samples.iloc[first + 1]

    set_point = here["set_point_m"].to_numpy()
    rest_v = plant.equilibrium(set_point).voltage_v
    logged = (samples["gap_velocity_origin"] != "reconstructed").to_numpy(dtype=bool)
    duration = there["t"].reset_index(drop=True) - here["t"].reset_index(drop=True)
    return Pairs(
        state=process.deviation(plant, _state(here), set_point),
        next_state=process.deviation(plant, _state(there), set_point),
        voltage_v=here["voltage_v"].to_numpy() - rest_v,
        next_voltage_v=there["voltage_v"].to_numpy() - rest_v,
        duration_s=np.asarray(duration.dt.total_seconds(), dtype=np.float64),
        touches=there["contact"].to_numpy(dtype=bool),
        velocity_logged=logged[first] & logged[first + 1],
        last=~np.append(joined, False)[first + 1],
        place=here[list(PLACE)].reset_index(drop=True),
        samples=samples,
        row=first,
    )


def _state(samples: pd.DataFrame) -> State:
    return State(*(samples[name].to_numpy() for name in ("gap_m", "gap_velocity_m_s", "current_a")))
