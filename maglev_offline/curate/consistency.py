"""How far a row is from what the simulator says of its state and voltage."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.curate.constructions.rows import NEXT_STATE, STATE
from maglev_offline.curate.simulator import hold
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


def one_step_residual(table: pd.DataFrame, plant: Plant, mdp: Mdp) -> NDArray[np.float64]:
    """Distance [n] between the row's next state and the simulator's, each deviation over its `mdp.state_scale`.

    The simulator holds the row's voltage for as long as the row says that it was held: its duration, but for one
    decision where the origin is `raw`, since that is what such a row tells an agent. Dimensionless; Euclidean norm.
    """
    state, following = table[list(STATE)].to_numpy(), table[list(NEXT_STATE)].to_numpy()
    voltage = table["voltage_deviation_v"].to_numpy()
    steps = np.maximum(1, np.rint(table["duration_s"].to_numpy() / mdp.plant_step_s)).astype(np.int64)
    steps[(table["origin"] == "raw").to_numpy()] = mdp.plant_steps_per_decision
    residual = np.zeros(len(table))
    for count in np.unique(steps):
        mine = steps == count
        said = hold(plant, mdp, state[mine], voltage[mine], int(count)).next_state
        residual[mine] = np.linalg.norm((following[mine] - said) / mdp.state_scale, axis=1)
    return residual


def inconsistent(residual: NDArray[np.float64], fraction: float) -> NDArray[np.bool_]:
    """Mark all rows but the `fraction` of them with the least residual, of which one remains at least; shape [n].

    Of equal residuals the earlier row is kept.
    """
    keep = max(1, round(fraction * len(residual)))
    marked = np.ones(len(residual), dtype=np.bool_)
    marked[np.argsort(residual, kind="stable")[:keep]] = False
    return marked
