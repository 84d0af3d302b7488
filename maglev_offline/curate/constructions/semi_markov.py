"""`semi_markov`: a pair is one decision that lasts as long as the pair."""

import numpy as np
import pandas as pd

from maglev_offline import mdp as process
from maglev_offline.curate.constructions.interpolation import state_between
from maglev_offline.curate.constructions.rows import one_row_a_pair, table_of
from maglev_offline.curate.pairs import Pairs
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


def semi_markov_rows(pairs: Pairs, _plant: Plant, mdp: Mdp) -> pd.DataFrame:
    """One row a pair: s, u and s' as logged; the cost is that of the whole duration, and so is the discount.

    The discount is gamma^(duration / control period). The cost is the stage cost summed over the plant steps of the
    duration, at the interpolated states and the logged voltage; each plant step counts gamma^k, where k is the number
    of whole control periods before it, as it would in the target of k decisions (Sutton, Precup and Singh, 1999).
    A duration that is no whole number of plant steps is cut into the nearest number of equal ones.
    """
    steps = np.maximum(1, np.rint(pairs.duration_s / mdp.plant_step_s)).astype(np.int64)
    step_s = pairs.duration_s / steps
    period_s = mdp.plant_steps_per_decision * mdp.plant_step_s
    cost = np.zeros(len(pairs))
    for k in range(int(steps.max(initial=0))):
        pair = np.flatnonzero(steps > k)
        after_s = k * step_s[pair]
        stage = process.stage_cost(mdp, state_between(pairs, pair, after_s), pairs.voltage_v[pair])
        passed = np.floor(after_s / period_s + 1e-9)
        cost[pair] += mdp.discount**passed * stage * step_s[pair] / mdp.plant_step_s
    rows = one_row_a_pair(pairs, cost=cost, discount=mdp.discount ** (pairs.duration_s / period_s))
    return table_of(rows, pairs, mdp, "semi_markov")
