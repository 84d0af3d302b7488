"""Which transitions can be used; how they are made is in `constructions`."""

import numpy as np
import pandas as pd

from maglev_offline import mdp as process
from maglev_offline.curate.constructions.rows import NEXT_STATE as NEXT_STATE
from maglev_offline.curate.constructions.rows import STATE as STATE
from maglev_offline.mdp import Mdp

MOST_UNCERTAIN = 0.2
"""A recovered row whose state is not known to a fifth of a state scale (0.5 mm, 15 mm/s, 0.75 A) is not of
that state: so it is in the first intervals of a run, and where the law's voltage leaves its limit between samples."""


def unusable(table: pd.DataFrame, mdp: Mdp) -> pd.Series:
    """Why a transition cannot be used, as a stable reason code; empty where it can."""
    numbers = table[[*STATE, "voltage_deviation_v", "cost", *NEXT_STATE]].to_numpy()
    reason = np.full(len(table), "", dtype=object)
    short = table["duration_s"].to_numpy() < (1 - 1e-6) * mdp.control_period_ms / 1e3
    reason[short & table["origin"].isin(["interpolated", "consistent"]).to_numpy()] = "shorter_than_a_decision"
    smoothed, uncertainty = (table["origin"] == "reconstructed").to_numpy(), table["uncertainty"].to_numpy()
    reason[smoothed & np.isnan(uncertainty)] = "not_recovered"
    reason[smoothed & (uncertainty > MOST_UNCERTAIN)] = "too_uncertain"
    reason[smoothed & short] = "shorter_than_a_decision"
    reason[smoothed & np.isinf(uncertainty)] = "not_explained_by_plant"
    reason[np.abs(process.action(mdp, table["voltage_deviation_v"].to_numpy())) > 1] = "voltage_outside_limit"
    reason[~np.isfinite(numbers).all(axis=1)] = "not_finite"
    return pd.Series(reason, index=table.index)
