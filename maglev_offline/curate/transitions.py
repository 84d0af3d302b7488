"""Transitions from consecutive samples, with the one-step cost of the one decision process (paper, Sec. V)."""

import numpy as np
import pandas as pd

from maglev_offline import mdp as process
from maglev_offline.curate.constructions import CONSTRUCTIONS
from maglev_offline.curate.constructions.rows import NEXT_STATE as NEXT_STATE
from maglev_offline.curate.constructions.rows import STATE as STATE
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.settings import ConstructionName
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


def transitions_of(
    samples: pd.DataFrame, plant: Plant, mdp: Mdp, construction: ConstructionName = "raw"
) -> pd.DataFrame:
    """Pair each sample with the next one of its segment, and make rows of the pairs.

    Returns the rows of the construction (see `constructions`) with the columns of `constructions.rows.table_of`.
    """
    return CONSTRUCTIONS[construction](pairs_of(samples, plant), plant, mdp)


def unusable(table: pd.DataFrame, mdp: Mdp) -> pd.Series:
    """Why a transition cannot be used, as a stable reason code; empty where it can."""
    numbers = table[[*STATE, "voltage_deviation_v", "cost", *NEXT_STATE]].to_numpy()
    reason = np.full(len(table), "", dtype=object)
    short = table["duration_s"].to_numpy() < (1 - 1e-6) * mdp.control_period_ms / 1e3
    reason[short & (table["origin"] == "interpolated").to_numpy()] = "shorter_than_a_decision"
    reason[np.abs(process.action(mdp, table["voltage_deviation_v"].to_numpy())) > 1] = "voltage_outside_limit"
    reason[~np.isfinite(numbers).all(axis=1)] = "not_finite"
    return pd.Series(reason, index=table.index)
