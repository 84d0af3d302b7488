import numpy as np
import pytest

from maglev_offline.errors import InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.exports.rows import as_rows, refuse_own_discounts

PLANT, MDP = Plant(), Mdp()


def changed(columns, name, row, value):
    column = columns[name].copy()
    column[row] = value
    return {**columns, name: column}


def test_the_reward_is_minus_the_cost_and_the_rest_is_as_it_was(columns, rows):
    np.testing.assert_array_equal(rows.reward, -columns["cost"])
    np.testing.assert_array_equal(rows.observation, columns["observation"])
    np.testing.assert_array_equal(rows.next_observation, columns["next_observation"])
    np.testing.assert_array_equal(rows.action[:, 0], columns["action"])
    np.testing.assert_array_equal(rows.discount, columns["discount"])


def test_each_row_ends_its_episode_either_way(columns, rows):
    np.testing.assert_array_equal(rows.terminated, columns["terminated"])
    np.testing.assert_array_equal(rows.truncated, ~columns["terminated"])
    assert 0 < rows.terminated.sum() < len(rows.terminated)


@pytest.mark.parametrize("name", ["observation", "next_observation", "action", "cost", "discount"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_row_that_is_not_finite_is_refused_by_row_and_column(columns, name, value):
    with pytest.raises(InputError, match=f"row 7, column {name}: the value is not finite"):
        as_rows(changed(columns, name, 7, value), "raw", PLANT, MDP)


@pytest.mark.parametrize("value", [1.001, -200.0])
def test_an_action_in_volt_is_refused(columns, value):
    with pytest.raises(InputError, match=r"row 3, column action: .* outside \[-1, 1\] \(1 such rows\)"):
        as_rows(changed(columns, "action", 3, value), "raw", PLANT, MDP)


@pytest.mark.parametrize("name", ["observation", "next_observation"])
def test_states_that_were_scaled_twice_are_refused(columns, name):
    with pytest.raises(
        InputError, match=rf"column {name}: a gap error of .* m, .*travels 0.0155 m: it was scaled twice"
    ):
        as_rows({**columns, name: columns[name] / MDP.state_scale}, "raw", PLANT, MDP)


def test_one_discount_for_all_rows_is_that_of_the_process(rows, semi_markov):
    refuse_own_discounts(rows, "any library")
    with pytest.raises(InputError, match=r"96 rows of the construction semi_markov.*0.3487.*has 0.9.*npz or torchrl"):
        refuse_own_discounts(semi_markov, "any library")
