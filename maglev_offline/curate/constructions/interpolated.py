"""`interpolated`: the states and voltages between two samples, a row for each control period."""

import numpy as np
import pandas as pd

from maglev_offline import mdp as process
from maglev_offline.curate.constructions.interpolation import state_between, voltage_between
from maglev_offline.curate.constructions.rows import Rows, table_of
from maglev_offline.curate.pairs import Pairs
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


def interpolated_rows(pairs: Pairs, _plant: Plant, mdp: Mdp) -> pd.DataFrame:
    """As many rows a pair as it has whole control periods; each is one decision, between two interpolated states.

    The voltage is that at the beginning of the row, on the line between the two logged ones. The cost is the stage
    cost summed over the plant steps at the interpolated states, with that voltage. What is left of a pair after its
    whole control periods gives no row. A pair that is shorter than a control period gives one row that lasts as long
    as the pair does, which `unusable` leaves out: between two samples there is no decision to be seen.
    """
    period_s = mdp.plant_steps_per_decision * mdp.plant_step_s
    whole = np.floor(pairs.duration_s / period_s + 1e-6).astype(np.int64)
    count = np.maximum(whole, 1)
    pair = np.repeat(np.arange(len(pairs)), count)
    substep = np.arange(len(pair)) - np.repeat(np.cumsum(count) - count, count)
    begin_s = substep * period_s
    duration_s = np.minimum(period_s, pairs.duration_s[pair])
    end_s = np.minimum(begin_s + duration_s, pairs.duration_s[pair])
    voltage_v = voltage_between(pairs, pair, begin_s)
    cost = np.zeros(len(pair))
    for k in range(mdp.plant_steps_per_decision):
        cost += process.stage_cost(mdp, state_between(pairs, pair, begin_s + k * mdp.plant_step_s), voltage_v)
    final = substep == count[pair] - 1
    rows = Rows(
        state=state_between(pairs, pair, begin_s),
        voltage_v=voltage_v,
        cost=cost,
        next_state=state_between(pairs, pair, end_s),
        duration_s=duration_s,
        discount=np.full(len(pair), mdp.discount),
        # Contact is at the second sample: the decision that ends there meets it.
        touches=pairs.touches[pair] & (end_s >= pairs.duration_s[pair] - 1e-6 * period_s),
        last=pairs.last[pair] & final,
        pair=pair,
        substep=substep,
    )
    return table_of(rows, pairs, mdp, "interpolated")
