import numpy as np

from maglev_offline.curate.constructions.raw import raw_rows
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.mdp import Mdp, row_cost
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp(discount=0.95)


def test_a_row_is_the_pair_as_logged_taken_as_one_decision(samples_of):
    pairs = pairs_of(samples_of([0.007, 0.009, 0.010], voltage_v=30.0), PLANT)
    table = raw_rows(pairs, PLANT, MDP)
    np.testing.assert_array_equal(table["next_gap_error_m"], pairs.next_state[:, 0])
    np.testing.assert_allclose(table["cost"], row_cost(MDP, pairs.state, pairs.voltage_v))
    np.testing.assert_array_equal(table["discount"], 0.95)
    np.testing.assert_allclose(table["duration_s"], 0.1)
