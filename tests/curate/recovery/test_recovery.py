"""The recovery against surrogate logs whose truth is known: 100 ms samples of gap, current and voltage, no velocity."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.curate.constructions.reconstructed import reconstructed_rows
from maglev_offline.curate.constructions.rows import STATE
from maglev_offline.curate.diagnostic import diagnose
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.logs import recover_logs
from maglev_offline.curate.recovery.settings import RecoverySettings
from maglev_offline.curate.recovery.tracks import ORIGINS
from maglev_offline.curate.recovery.verdict import recovery_facts
from maglev_offline.curate.recovery.words import recovery_words
from maglev_offline.curate.transitions import unusable
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()
PID = RecoverySettings(law="pid", acceleration_noise_std_m_s2=0.02, disturbance_std_m_s2=0.05, voltage_noise_std_v=0.1)


@pytest.fixture(scope="module")
def pairs(logged):
    return pairs_of(logged, PLANT)


@pytest.fixture(scope="module")
def recovered(pairs):
    return recover_logs(pairs.samples, PLANT, MDP, Belief(PID))


def test_the_states_err_by_what_the_covariance_says_and_the_velocity_far_less_than_differences_do(
    pairs, recovered, true_states
):
    table = reconstructed_rows(pairs, PLANT, MDP, recovered)
    fine = np.isfinite(table["uncertainty"].to_numpy())
    assert fine.mean() > 0.8
    truth = true_states(table)[fine]
    error = table[list(STATE)].to_numpy()[fine] - truth
    squared = (error / recovered.periods.std[recovered.explained]) ** 2
    assert (np.median(squared, axis=0) > 0.045).all()
    assert (squared.mean(axis=0) < 1.5).all()
    first = (table["substep"] == 0).to_numpy()[fine]
    by_differences = pairs.state[_pair_of(table, pairs)[fine][first], 1] - truth[first, 1]
    assert np.sqrt(np.mean(error[first, 1] ** 2)) < 0.1 * np.sqrt(np.mean(by_differences**2))


def _pair_of(table, pairs):
    key = ["point", "segment", "step"]
    number = pairs.place[key].assign(pair=np.arange(len(pairs)))
    return table[key].merge(number, on=key, how="left")["pair"].to_numpy()


def test_its_rows_have_a_correlation_above_0_9_with_the_true_advantage(pairs, recovered):
    table = reconstructed_rows(pairs, PLANT, MDP, recovered)
    found = diagnose(table[unusable(table, MDP) == ""].iloc[::8], PLANT, MDP, 0)
    assert found.correlation_with_advantage > 0.9
    assert found.verdict == "fit"


def test_the_law_is_found_and_the_verdict_says_what_is_known(pairs, logged):
    found = recover_logs(pairs.samples, PLANT, MDP)
    facts = recovery_facts(pairs.samples, found.logs)
    assert facts["laws"] == {"pid": 1}
    assert facts["signals"] == {"gap": "logged", "velocity": "reconstructed", "current": "logged", "voltage": "logged"}
    assert facts["phase_rad"] == facts["phase_rad_by_law"]["pid"] == pytest.approx(3.06, abs=0.02)
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


def test_a_value_that_stands_for_a_missing_message_says_nothing(logged):
    """Whatever is written there: the way between the samples beside it comes from plant and law."""
    point, segment = logged.groupby(["point", "segment"]).size().idxmax()
    samples = logged[(logged["point"] == point) & (logged["segment"] == segment)].reset_index(drop=True)
    found = []
    for wrong in (0.0, 1.0):
        bridged = samples.assign(**dict.fromkeys(ORIGINS, "measured"))
        bridged.loc[10, list(ORIGINS)] = "bridged"
        bridged.loc[10, ["gap_m", "current_a", "voltage_v"]] += wrong * np.array([1e-3, 2.0, 5.0])
        found.append(recover_logs(bridged, PLANT, MDP, Belief(PID)).periods)
    assert np.abs((found[0].state - found[1].state) / MDP.state_scale).max() < 0.01
    near = np.abs(found[0].sample - 10) <= 1
    assert found[0].std[near].mean() > found[0].std[~near].mean()


def test_where_a_stop_may_have_been_met_nothing_is_known(logged):
    samples = logged[logged["segment"] == 0].copy()
    first = samples.groupby("point").head(2).index
    samples.loc[first, "gap_m"] = PLANT.gap_max_m - 5e-5
    found = recover_logs(pairs_of(samples, PLANT).samples, PLANT, MDP, Belief(PID))
    begins = pairs_of(samples, PLANT).samples["step"].to_numpy()[found.periods.sample] == 0
    assert not found.explained[begins].any()
    assert found.explained[~begins].mean() > 0.5


@settings(max_examples=2, deadline=None)
@given(seed=st.integers(0, 99))
def test_neither_the_order_of_samples_nor_what_lies_beside_a_segment_matters(logged, seed):
    samples = logged[(logged["segment"] == 0) & (logged["step"] < 8)]
    together, mixed = _periods(samples), _periods(samples.sample(frac=1, random_state=seed))
    assert all(np.array_equal(one, other) for one, other in zip(together, mixed, strict=True))
    point = samples["point"].unique()[seed % samples["point"].nunique()]
    mine = (pairs_of(samples, PLANT).samples["point"] == point).to_numpy()[together.sample]
    alone = _periods(samples[samples["point"] == point])
    np.testing.assert_allclose(alone.state, together.state[mine], rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(alone.std, together.std[mine], rtol=1e-7)


@settings(max_examples=2, deadline=None)
@given(times=st.floats(1.5, 4.0))
def test_worse_sensors_leave_less_known(logged, times):
    samples = logged[(logged["segment"] == 0) & (logged["step"] < 8)]
    names = ("gap_std_m", "current_std_a", "voltage_std_v")
    worse = PID.model_copy(update={name: times * getattr(PID, name) for name in names})
    less = recover_logs(pairs_of(samples, PLANT).samples, PLANT, MDP, Belief(worse)).periods
    assert less.std.mean() > _periods(samples).std.mean()
    assert less.std.mean() < times * 1.05 * _periods(samples).std.mean()


def _periods(samples):
    return recover_logs(pairs_of(samples, PLANT).samples, PLANT, MDP, Belief(PID)).periods


def test_a_law_has_to_be_clearly_better_than_none(logged):
    """Voltages that no law made: neither of the two explains them."""
    rng = np.random.default_rng(1)
    samples = logged[(logged["segment"] == 0) & (logged["step"] < 10)]
    samples = samples.assign(voltage_v=20 + 5 * rng.standard_normal(len(samples)))
    assert [one.law for one in recover_logs(pairs_of(samples, PLANT).samples, PLANT, MDP).logs] == ["none"]
