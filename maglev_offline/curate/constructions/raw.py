"""`raw`: the rows of the paper (Zhao et al., Sec. V)."""

import numpy as np
import pandas as pd

from maglev_offline import mdp as process
from maglev_offline.curate.constructions.rows import one_row_a_pair, table_of
from maglev_offline.curate.pairs import Pairs
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


def raw_rows(pairs: Pairs, _plant: Plant, mdp: Mdp) -> pd.DataFrame:
    """One row a pair: s, u and s' as logged, the cost c(s, u) of one decision, and the discount of one decision.

    It is a closed-loop transition over `duration_s`, not "this action for this long": between the samples the logged
    controller went on acting. Where the samples are further apart than decisions, the row says of one decision what
    many have done.
    """
    cost = process.row_cost(mdp, pairs.state, pairs.voltage_v)
    rows = one_row_a_pair(pairs, cost=cost, discount=np.full(len(pairs), mdp.discount))
    return table_of(rows, pairs, mdp, "raw")
