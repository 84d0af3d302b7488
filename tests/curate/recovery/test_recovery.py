"""The recovery against surrogate logs whose truth is known: 100 ms samples of gap, current and voltage, no velocity."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.constructions import CONSTRUCTIONS
from maglev_offline.curate.constructions.reconstructed import reconstructed_rows
from maglev_offline.curate.constructions.rows import NEXT_STATE, STATE
from maglev_offline.curate.diagnostic import diagnose, targets_of
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.logs import recover_logs
from maglev_offline.curate.recovery.settings import RecoverySettings
from maglev_offline.curate.recovery.verdict import recovery_facts
from maglev_offline.curate.recovery.words import recovery_words
from maglev_offline.curate.transitions import unusable
from maglev_offline.mdp import Mdp, deviation
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()
NOISE = {"gap_m": 1e-5, "current_a": 0.02, "voltage_v": 0.1}
PID = RecoverySettings(law="pid", acceleration_noise_std_m_s2=0.02, disturbance_std_m_s2=0.05, voltage_noise_std_v=0.1)


@pytest.fixture(scope="module")
def logged(samples_every):
    """Noisy samples without a velocity: what stands in its place are differences of the gap."""
    samples, rng = samples_every(100), np.random.default_rng(4)
    for name, std in NOISE.items():
        samples[name] += rng.normal(0, std, len(samples))
    gap = samples.groupby(["point", "segment"])["gap_m"]
    samples["gap_velocity_m_s"] = ((gap.shift(-1) - gap.shift(1)) / 0.2).fillna(0.0)
    return samples.assign(gap_velocity_origin="reconstructed")


@pytest.fixture(scope="module")
def pairs(logged):
    return pairs_of(logged, PLANT)


@pytest.fixture(scope="module")
def recovered(pairs):
    return recover_logs(pairs.samples, PLANT, MDP, Belief(PID))


def true_states(table, truth):
    """Deviation [n, 3] and voltage deviation [n] of the 1 kHz truth when each row begins."""
    key = ["point", "segment", "t"]
    found = table[key].merge(truth, on=key, how="left")
    began = table[["point", "segment"]].assign(step=table["step"] * 100)
    own = began.merge(truth, on=["point", "segment", "step"], how="left")
    at = own["set_point_m"].to_numpy()  # a row keeps the set-point of its pair
    state = State(*(found[n].to_numpy() for n in ("gap_m", "gap_velocity_m_s", "current_a")))
    return deviation(PLANT, state, at), found["voltage_v"].to_numpy() - PLANT.equilibrium(at).voltage_v


def test_the_velocity_errs_by_what_the_covariance_says_and_far_less_than_differences_do(
    pairs, recovered, samples_every
):
    table = reconstructed_rows(pairs, PLANT, MDP, recovered)
    fine = np.isfinite(table["uncertainty"].to_numpy())
    assert fine.mean() > 0.8
    error = (table[list(STATE)].to_numpy() - true_states(table, samples_every(1))[0])[fine]
    std = recovered.periods.std[recovered.explained]
    nees = np.median((error / std) ** 2, axis=0) / 0.455  # the median of chi-square with one degree of freedom
    assert (nees > 0.1).all()
    assert (nees < 3).all()
    first = (table["substep"] == 0).to_numpy()[fine]
    truth = true_states(table, samples_every(1))[0][fine]
    by_differences = pairs.state[_pair_of(table, pairs)[fine][first], 1] - truth[first, 1]
    assert np.sqrt(np.mean(error[first, 1] ** 2)) < 0.1 * np.sqrt(np.mean(by_differences**2))


def _pair_of(table, pairs):
    key = ["point", "segment", "step"]
    number = pairs.place[key].assign(pair=np.arange(len(pairs)))
    return table[key].merge(number, on=key, how="left")["pair"].to_numpy()


def test_its_rows_have_a_correlation_above_0_9_with_the_true_advantage(pairs, recovered):
    table = reconstructed_rows(pairs, PLANT, MDP, recovered)
    found = diagnose(table[unusable(table, MDP) == ""].iloc[::3], PLANT, MDP, 0)
    assert found.correlation_with_advantage > 0.9
    assert found.verdict == "fit"


def test_the_diagnostic_ranks_constructions_as_their_errors_against_the_truth_do(pairs, recovered, samples_every):
    """The truth: what the simulator makes of the true state and of the voltage that the row names."""
    truth, judged, true = samples_every(1), {}, {}
    for name in ("raw", "interpolated", "reconstructed"):
        more = (recovered,) if name == "reconstructed" else ()
        table = CONSTRUCTIONS[name](pairs, PLANT, MDP, *more)
        table = table[unusable(table, MDP) == ""].iloc[:: 1 if name == "raw" else 7].reset_index(drop=True)
        judged[name] = diagnose(table, PLANT, MDP, 0).error_over_advantage_std
        state, voltage = true_states(table, truth)
        keep = np.isfinite(state).all(axis=1) & (np.abs(voltage) <= MDP.voltage_limit_v)
        real = table.assign(**dict(zip(STATE, state.T, strict=True)))[keep]
        of_truth = targets_of(real.assign(voltage_deviation_v=table["voltage_deviation_v"]), PLANT, MDP)
        taught = table["cost"].to_numpy()[keep]
        taught = targets_of(real.assign(cost=taught, **{n: table.loc[keep, n] for n in NEXT_STATE}), PLANT, MDP).taught
        true[name] = np.sqrt(np.mean((taught - of_truth.true) ** 2)) / of_truth.advantage.std()
    assert sorted(judged, key=judged.get) == sorted(true, key=true.get)
    assert min(judged, key=judged.get) == "reconstructed"


def test_the_law_is_found_and_the_verdict_says_what_is_known(pairs, logged):
    found = recover_logs(pairs.samples, PLANT, MDP)
    facts = recovery_facts(pairs.samples, found.logs)
    assert facts["laws"] == {"pid": 1}
    assert facts["signals"] == {"gap": "logged", "velocity": "reconstructed", "current": "logged", "voltage": "logged"}
    assert facts["phase_rad"] == pytest.approx(3.06, abs=0.02)
    assert facts["verdict"] == "trustworthy"
    assert "velocity reconstructed" in recovery_words(facts)


def test_what_another_plant_explains_is_marked_and_not_lost(pairs):
    """Twice the mass: the samples are not of this plant."""
    heavy, belief = Plant(mass_kg=2100), Belief(PID)
    found = recover_logs(pairs.samples, heavy, MDP, belief)
    table = reconstructed_rows(pairs, heavy, MDP, found)
    assert set(_pair_of(table, pairs)) == set(range(len(pairs)))
    assert (unusable(table, MDP) == "not_explained_by_plant").mean() > 0.9
    assert recovery_facts(pairs.samples, found.logs)["verdict"] == "not_identifiable"


def test_a_pair_that_ends_in_contact_gives_a_row_that_says_so(logged):
    point, segment = logged.groupby(["point", "segment"]).size().idxmax()
    samples = logged[(logged["point"] == point) & (logged["segment"] == segment)].reset_index(drop=True)
    samples["contact"] = np.arange(len(samples)) == len(samples) - 1
    pairs = pairs_of(samples, PLANT)
    table = reconstructed_rows(pairs, PLANT, MDP, recover_logs(pairs.samples, PLANT, MDP, Belief(PID)))
    assert (unusable(table, MDP) == "not_recovered").sum() == 1
    assert pd.isna(table["uncertainty"].iloc[-1])
