"""Transitions from consecutive samples, with the one-step cost of the one decision process (paper, Sec. V)."""

import numpy as np
import pandas as pd

from maglev_offline import mdp as process
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

STATE = process.STATE_NAMES
"""The three columns of the state s, relative to the equilibrium at the row's own set-point."""

NEXT_STATE = tuple(f"next_{name}" for name in STATE)
"""The three columns of s', relative to the same set-point; stored, never implied by the next row."""


def transitions_of(samples: pd.DataFrame, plant: Plant, mdp: Mdp) -> pd.DataFrame:
    """Pair each sample with the next one of its segment.

    A row is what the paper puts into the buffer: the state and voltage logged at t, the cost c(s, u), and the state
    logged one grid step later. It is a closed-loop transition over `duration_s`, not "this action for this long":
    between the samples the logged controller went on acting.

    Returns one row for each pair of neighbours with the columns of `STATE`, `voltage_deviation_v`, `cost`,
    `NEXT_STATE`, `duration_s`, `terminated` (contact, where the process ends there), `truncated` (last of its
    segment), `log_id`, `point`, `t`, `segment`, `step`.
    """
    samples = samples.sort_values(["log_id", "point", "segment", "step"], kind="stable", ignore_index=True)
    key = samples[["log_id", "point", "segment"]]
    joined = (key.iloc[:-1].to_numpy() == key.iloc[1:].to_numpy()).all(axis=1)
    first = np.flatnonzero(joined)
    here, there = samples.iloc[first], samples.iloc[first + 1]

    set_point = here["set_point_m"].to_numpy()
    z = process.deviation(plant, _state(here), set_point)
    z_next = process.deviation(plant, _state(there), set_point)
    v = here["voltage_v"].to_numpy() - plant.equilibrium(set_point).voltage_v
    touches = there["contact"].to_numpy(dtype=bool)
    table = pd.DataFrame(dict(zip(STATE, z.T, strict=True)))
    table["voltage_deviation_v"] = v
    table["cost"] = process.row_cost(mdp, z, v) + mdp.contact_penalty * touches
    table = table.assign(**dict(zip(NEXT_STATE, z_next.T, strict=True)))
    duration = there["t"].reset_index(drop=True) - here["t"].reset_index(drop=True)
    table["duration_s"] = duration.dt.total_seconds()
    table["terminated"] = touches & mdp.terminate_on_contact
    table["truncated"] = ~np.append(joined, False)[first + 1] & ~table["terminated"].to_numpy()
    for name in ("log_id", "point", "t", "segment", "step"):
        table[name] = here[name].to_numpy()
    table["t"] = here["t"].reset_index(drop=True)
    return table


def _state(samples: pd.DataFrame) -> State:
    return State(*(samples[name].to_numpy() for name in ("gap_m", "gap_velocity_m_s", "current_a")))


def unusable(table: pd.DataFrame, mdp: Mdp) -> pd.Series:
    """Why a transition cannot be used, as a stable reason code; empty where it can."""
    numbers = table[[*STATE, "voltage_deviation_v", "cost", *NEXT_STATE]].to_numpy()
    reason = np.full(len(table), "", dtype=object)
    reason[np.abs(process.action(mdp, table["voltage_deviation_v"].to_numpy())) > 1] = "voltage_outside_limit"
    reason[~np.isfinite(numbers).all(axis=1)] = "not_finite"
    return pd.Series(reason, index=table.index)
