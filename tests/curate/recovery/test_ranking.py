"""The diagnostic judges rows by the recipe's simulator at the state that they claim; here is what the world says.

The true target error (docs/protocol.md): what a row teaches, against one decision with its voltage in the surrogate's
own plant, from the true state when it begins. Where the velocity was logged, and where it was not and the recipe's
plant is 3 % too light.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import spearmanr

from maglev_offline.curate.consistency import inconsistent, one_step_residual
from maglev_offline.curate.constructions import CONSTRUCTIONS
from maglev_offline.curate.constructions.rows import NEXT_STATE
from maglev_offline.curate.diagnostic import FIT_ERROR, HARMFUL_ERROR, diagnose
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.logs import recover_logs
from maglev_offline.curate.recovery.settings import RecoverySettings
from maglev_offline.curate.reference_value import reference_policy, value
from maglev_offline.curate.transitions import unusable
from maglev_offline.mdp import Mdp, deviation, stage_cost
from maglev_offline.physics.dynamics import State, step
from maglev_offline.physics.parameters import Plant

WORLD, MDP = Plant(), Mdp()
MOST_ROWS = 200


class Errors(NamedTuple):
    """Error over the spread of the advantage, by construction: what the diagnostic says, and what the world says."""

    judged: dict[str, float]
    true: dict[str, float]


def error_in_the_world(table, state, recipe):
    """Error over the advantage's spread of the targets that rows teach, from the true deviations `state` [n, 3]."""
    n, rest, voltage_v = len(table), recipe.equilibrium(), table["voltage_deviation_v"].to_numpy()
    now = State(state[:, 0] + rest.gap_m, state[:, 1], state[:, 2] + rest.current_a)
    cost = np.zeros(n)
    for _ in range(MDP.plant_steps_per_decision):
        cost += stage_cost(MDP, deviation(recipe, now), voltage_v)
        now = step(WORLD, now, rest.voltage_v + voltage_v, MDP.plant_step_s, integrator="rk4")
    states = np.concatenate([state, deviation(recipe, now), table[list(NEXT_STATE)].to_numpy()])
    here, truly, taught = value(recipe, MDP, reference_policy(recipe, MDP), states).reshape(3, n)
    true = cost + MDP.discount * truly
    error = table["cost"].to_numpy() + table["discount"].to_numpy() * taught - true
    return float(np.sqrt(np.mean(error**2)) / np.std(true - here))


def errors_of(samples, recipe, true_states):
    judged, true, pairs = {}, {}, pairs_of(samples, recipe)
    recovered = recover_logs(pairs.samples, recipe, MDP, Belief(RecoverySettings(law="pid")))
    for name, make in CONSTRUCTIONS.items():
        known = (recovered,) if name == "reconstructed" else ()
        table = make(pairs, recipe, MDP, *known)
        table = table[unusable(table, MDP) == ""].reset_index(drop=True)
        if name == "consistent":
            table = table[~inconsistent(one_step_residual(table, recipe, MDP), 0.25)]
        table = table.iloc[:: max(1, len(table) // MOST_ROWS)].reset_index(drop=True)
        judged[name] = diagnose(table, recipe, MDP, 0).error_over_advantage_std
        true[name] = error_in_the_world(table, true_states(table, recipe), recipe)
    return Errors(judged, true)


@pytest.fixture(scope="module")
def with_velocity(logged, samples_every, true_states):
    """Logs that hold a velocity, with noise, and a recipe that knows the plant."""
    truth = samples_every(100)
    noise = np.random.default_rng(5).normal(0, 1e-3, len(truth))
    samples = logged.assign(gap_velocity_m_s=truth["gap_velocity_m_s"] + noise, gap_velocity_origin="measured")
    return errors_of(samples, WORLD, true_states)


@pytest.fixture(scope="module")
def without_velocity(logged, true_states):
    """Logs whose velocities are differences of the gap, and a recipe whose plant is too light."""
    return errors_of(logged, Plant(mass_kg=680), true_states)


def band(error):
    return "fit" if error <= FIT_ERROR else "harmful" if error >= HARMFUL_ERROR else "doubtful"


def ranked(errors, names):
    return sorted(names, key=errors.get)


OF_LOGS = ("reconstructed", "interpolated", "raw")


def test_the_diagnostic_ranks_the_constructions_as_the_world_does(with_velocity):
    judged, true = with_velocity
    assert spearmanr(list(judged.values()), list(true.values())).statistic > 0.9
    others = set(judged) - {"simulated_next"}
    assert ranked(judged, others)[:3] == ranked(true, others)[:3] == ["reconstructed", "consistent", "interpolated"]


def test_it_puts_every_construction_into_the_band_where_it_belongs(with_velocity):
    judged, true = with_velocity
    assert {name: band(error) for name, error in judged.items()} == {name: band(error) for name, error in true.items()}


def test_without_a_velocity_it_still_ranks_what_the_logs_alone_made(without_velocity):
    judged, true = without_velocity
    assert ranked(judged, OF_LOGS) == ranked(true, OF_LOGS) == list(OF_LOGS)
    assert spearmanr(list(judged.values()), list(true.values())).statistic > 0.7


def test_reconstructed_rows_err_least_of_all_in_the_world(with_velocity, without_velocity):
    for _, true in (with_velocity, without_velocity):
        assert min(true, key=true.get) == "reconstructed"
        assert true["reconstructed"] < 0.1


def test_what_the_simulator_made_or_chose_is_judged_better_than_it_is(with_velocity, without_velocity):
    """`simulated_next` agrees with the simulator by construction, `consistent` by choice; wrong states show it."""
    assert with_velocity.judged["simulated_next"] == without_velocity.judged["simulated_next"] == 0
    assert without_velocity.true["simulated_next"] > 0.5
    assert without_velocity.judged["consistent"] < without_velocity.judged["interpolated"]
    assert without_velocity.true["consistent"] > 2 * without_velocity.judged["consistent"]
