"""The diagnostic judges rows by the recipe's simulator at the state that they claim; here is what the world says.

The world is the surrogate's own plant, 3 % heavier than the recipe's. The true target of a row (docs/protocol.md): from
the true state when it begins, its voltage held in that plant for as many decisions as its discount stands for.
"""

import numpy as np
import pytest

from maglev_offline.curate.consistency import inconsistent, one_step_residual
from maglev_offline.curate.constructions import CONSTRUCTIONS
from maglev_offline.curate.constructions.rows import NEXT_STATE
from maglev_offline.curate.diagnostic import diagnose
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.logs import recover_logs
from maglev_offline.curate.recovery.settings import RecoverySettings
from maglev_offline.curate.reference_value import reference_policy, value
from maglev_offline.curate.transitions import unusable
from maglev_offline.mdp import Mdp, deviation, stage_cost
from maglev_offline.physics.dynamics import State, step
from maglev_offline.physics.parameters import Plant

WORLD, RECIPE, MDP = Plant(), Plant(mass_kg=680), Mdp()
MOST_ROWS = 200


def errors_against_the_world(table, state):
    """Error over the advantage's spread of the targets that rows teach, from the true deviations `state` [n, 3]."""
    n, rest, voltage_v = len(table), RECIPE.equilibrium(), table["voltage_deviation_v"].to_numpy()
    discount = table["discount"].to_numpy()
    decisions = round(np.log(discount[0]) / np.log(MDP.discount))
    now = State(state[:, 0] + rest.gap_m, state[:, 1], state[:, 2] + rest.current_a)
    cost = np.zeros(n)
    for k in range(decisions * MDP.plant_steps_per_decision):
        paid = stage_cost(MDP, deviation(RECIPE, now), voltage_v)
        cost += MDP.discount ** (k // MDP.plant_steps_per_decision) * paid
        now = step(WORLD, now, rest.voltage_v + voltage_v, MDP.plant_step_s, integrator="rk4")
    states = np.concatenate([state, deviation(RECIPE, now), table[list(NEXT_STATE)].to_numpy()])
    here, truly, taught = value(RECIPE, MDP, reference_policy(RECIPE, MDP), states).reshape(3, n)
    true = cost + discount * truly
    return np.sqrt(np.mean((table["cost"].to_numpy() + discount * taught - true) ** 2)) / np.std(true - here)


@pytest.fixture(scope="module")
def errors(logged, true_states):
    """Of each construction: by the diagnostic, and against the world."""
    judged, true, pairs = {}, {}, pairs_of(logged, RECIPE)
    recovered = recover_logs(pairs.samples, RECIPE, MDP, Belief(RecoverySettings(law="pid")))
    for name, make in CONSTRUCTIONS.items():
        known = (recovered,) if name == "reconstructed" else ()
        table = make(pairs, RECIPE, MDP, *known)
        table = table[unusable(table, MDP) == ""].reset_index(drop=True)
        if name == "consistent":
            table = table[~inconsistent(one_step_residual(table, RECIPE, MDP), 0.25)]
        table = table.iloc[:: max(1, len(table) // MOST_ROWS)].reset_index(drop=True)
        judged[name] = diagnose(table, RECIPE, MDP, 0).error_over_advantage_std
        true[name] = errors_against_the_world(table, true_states(table, RECIPE))
    return judged, true


def test_the_diagnostic_ranks_what_the_logs_alone_made_as_the_world_does(errors):
    for found in errors:
        of_logs = {name: found[name] for name in ("reconstructed", "interpolated", "raw")}
        assert sorted(of_logs, key=of_logs.get) == ["reconstructed", "interpolated", "raw"]


def test_reconstructed_rows_err_least_of_all_in_the_world(errors):
    _, true = errors
    assert min(true, key=true.get) == "reconstructed"
    assert true["reconstructed"] < 0.1


def test_what_the_simulator_made_or_chose_is_judged_better_than_it_is(errors):
    """`simulated_next` agrees with the simulator by construction, `consistent` by choice: but not with the world."""
    judged, true = errors
    assert judged["simulated_next"] == 0
    assert true["simulated_next"] > 0.5
    assert judged["consistent"] < judged["interpolated"]
    assert true["consistent"] > 2 * judged["consistent"]


def test_a_long_decision_is_judged_worse_than_it_is(errors):
    """The diagnostic judges `semi_markov` by one decision; the row speaks of ten."""
    judged, true = errors
    assert true["semi_markov"] < 0.5 * judged["semi_markov"]
