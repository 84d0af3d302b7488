"""Metrics of agents' responses from the reference start, by the same functions that judge classical controllers."""

import numpy as np
import pandas as pd

from maglev_offline.control import metrics
from maglev_offline.control.simulate import Trajectory
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


def agent_metrics(responses: pd.DataFrame, plant: Plant, mdp: Mdp) -> pd.DataFrame:
    """One row for algorithm, arm and seed, with the columns of control/metrics.parquet.

    `responses` holds the state at the beginning of every plant step and the voltage during it; the state after the
    last step is not in it, and is taken to be the last one known.
    """
    tables = []
    for (algorithm, arm), group in responses.groupby(["algorithm", "arm"], sort=False):
        columns = {}
        for name in ("gap_m", "gap_velocity_m_s", "current_a", "voltage_v"):
            columns[name] = group.pivot(index="t_s", columns="seed", values=name)
        t = columns["gap_m"].index.to_numpy(dtype=np.float64)
        gap, velocity, current = (
            np.vstack([x, x[-1:]])
            for x in (columns[name].to_numpy() for name in ("gap_m", "gap_velocity_m_s", "current_a"))
        )
        voltage = columns["voltage_v"].to_numpy()
        response = Trajectory(np.append(t, 2 * t[-1] - t[-2]), gap, velocity, current, voltage)
        found = metrics.response_metrics(plant, mdp, response)
        seeds = columns["gap_m"].columns.to_numpy()
        tables.append(pd.DataFrame({"algorithm": algorithm, "arm": arm, "seed": seeds, **found}))
    return pd.concat(tables, ignore_index=True)
