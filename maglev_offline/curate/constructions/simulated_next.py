"""`simulated_next`: the logged state and voltage; what comes of them is the simulator's."""

import numpy as np
import pandas as pd

from maglev_offline.curate.constructions.rows import one_row_a_pair, table_of
from maglev_offline.curate.pairs import Pairs
from maglev_offline.curate.simulator import hold
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


def simulated_next_rows(pairs: Pairs, plant: Plant, mdp: Mdp) -> pd.DataFrame:
    """One row a pair: s and u as logged; cost, contact and s' of the simulator, the voltage held for one decision.

    The log says which states and voltages occur, the simulator of `plant` what follows: no row contradicts it, and
    whatever is wrong with the simulator is in every row. Contact is the simulator's own, not that of the log.
    """
    n = len(pairs)
    held = hold(plant, mdp, pairs.state, pairs.voltage_v)
    rows = one_row_a_pair(
        pairs,
        cost=held.cost - mdp.contact_penalty * held.touched,
        discount=np.full(n, mdp.discount),
        next_state=held.next_state,
        duration_s=np.full(n, mdp.plant_steps_per_decision * mdp.plant_step_s),
        touches=held.touched,
    )
    return table_of(rows, pairs, mdp, "simulated_next")
