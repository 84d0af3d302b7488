"""The diagnostic knows the truth when it sees it, and says so only where the rows bear it out."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.constructions import CONSTRUCTIONS
from maglev_offline.curate.diagnostic import MOST_ROWS, diagnose, targets_of, verdict_of
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.reference_value import reference_policy, value
from maglev_offline.curate.transitions import unusable
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()


def test_rows_of_the_simulator_teach_the_truth(simulator_rows):
    found = diagnose(simulator_rows(400), PLANT, MDP, 0)
    assert found.error_over_advantage_std == pytest.approx(0, abs=1e-9)
    assert found.correlation_with_advantage == pytest.approx(1)
    assert found.verdict == "fit"


def test_an_end_in_contact_is_the_truth_too(samples_of):
    mdp = Mdp(terminate_on_contact=True, contact_penalty=2.0)
    gap, velocity = np.linspace(0.004, 0.0159, 100), np.linspace(-0.1, 0.2, 100)
    samples = pd.concat([samples_of(gap, velocity_m_s=velocity, segment=k, voltage_v=24 + k) for k in range(3)])
    table = CONSTRUCTIONS["simulated_next"](pairs_of(samples, PLANT), PLANT, mdp)
    assert 0 < table["terminated"].sum() < len(table)
    found = diagnose(table, PLANT, mdp, 0)
    assert found.error_over_advantage_std == pytest.approx(0, abs=1e-9)
    assert found.verdict == "fit"


def test_raw_rows_at_100_ms_are_far_below_rows_with_the_simulators_next_state(samples_every):
    """On logs of the paper's PID whose truth is known, and free of every defect."""
    pairs = pairs_of(samples_every(100), PLANT)
    found = {}
    for name in ("raw", "interpolated", "simulated_next"):
        table = CONSTRUCTIONS[name](pairs, PLANT, MDP)
        found[name] = diagnose(table[unusable(table, MDP) == ""], PLANT, MDP, 0)
    assert found["simulated_next"].verdict == "fit"
    assert found["raw"].verdict == "harmful"
    assert found["simulated_next"].correlation_with_advantage > 0.999
    assert found["raw"].correlation_with_advantage < 0.3
    assert found["simulated_next"].error_over_advantage_std < 1e-9
    assert found["raw"].error_over_advantage_std > 1
    errors = [one.error_over_advantage_std for one in found.values()]
    assert errors == sorted(errors, reverse=True)


def test_targets_are_those_of_the_definition(simulator_rows):
    table = simulator_rows(5)
    table["cost"] += [0, 1, 2, 3, 4]
    table["discount"] = 0.5
    policy = reference_policy(PLANT, MDP)
    here, there = (
        value(PLANT, MDP, policy, table[[f"{p}{n}" for n in ("gap_error_m", "gap_velocity_m_s", "current_error_a")]]
              .to_numpy())
        for p in ("", "next_")
    )  # fmt: skip
    found = targets_of(table, PLANT, MDP)
    true = table["cost"] - np.arange(5) + MDP.discount * there
    np.testing.assert_allclose(found.value, here)
    np.testing.assert_allclose(found.taught, table["cost"] + 0.5 * there)
    np.testing.assert_allclose(found.true, true)
    np.testing.assert_allclose(found.advantage, true - here)


def test_both_numbers_are_those_that_numpy_gives(simulator_rows):
    table = simulator_rows(300)
    table["cost"] += np.random.default_rng(1).normal(0.2, 0.5, 300)
    t, found = targets_of(table, PLANT, MDP), diagnose(table, PLANT, MDP, 0)
    advantage = t.true - t.value
    rms = np.sqrt(np.mean((t.taught - t.true) ** 2))
    assert found.error_over_advantage_std == pytest.approx(rms / advantage.std(), rel=1e-9)
    expected = np.corrcoef(t.taught - t.value, advantage)[0, 1]
    assert found.correlation_with_advantage == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("error", "verdict"), [(0.4, "fit"), (1.5, "doubtful"), (6.0, "harmful")])
def test_planted_errors_are_found_at_their_size_and_judged(simulator_rows, error, verdict):
    table = simulator_rows(2000, seed=2)
    spread = targets_of(table, PLANT, MDP).advantage.std()
    table["cost"] += np.random.default_rng(0).normal(0, error * spread, len(table))
    found = diagnose(table, PLANT, MDP, 0)
    low, high = found.error_over_advantage_std_interval
    assert low < error < high
    low, high = found.correlation_with_advantage_interval
    assert low < 1 / np.sqrt(1 + error**2) < high
    assert found.verdict == verdict


@pytest.mark.parametrize(
    ("error", "correlation", "verdict"),
    [
        ((0.1, 0.75), (0.8, 0.9), "fit"),
        ((0.1, 0.76), (0.8, 0.9), "doubtful"),
        ((0.1, 0.7), (0.79, 0.9), "doubtful"),
        ((2.9, 9.0), (0.4, 0.9), "doubtful"),
        ((3.0, 9.0), (0.4, 0.9), "harmful"),
        ((0.1, 0.7), (-0.5, 0.3), "harmful"),
        (None, (0.9, 1.0), "doubtful"),
        ((0.0, 0.1), None, "doubtful"),
    ],
)
def test_a_verdict_needs_the_whole_interval_on_its_side(error, correlation, verdict):
    assert verdict_of(error, correlation) == verdict


def test_the_same_seed_gives_the_same_numbers_and_many_rows_are_sampled(simulator_rows):
    table = pd.concat([simulator_rows(20)] * (MOST_ROWS // 20 + 5), ignore_index=True)
    table["t"] = pd.to_datetime(np.arange(len(table)) * 10**8, unit="ns", utc=True)
    table["cost"] += np.random.default_rng(0).normal(0, 1, len(table))
    first, again, other = (diagnose(table, PLANT, MDP, seed) for seed in (0, 0, 1))
    assert first == again != other
    assert first.rows == MOST_ROWS


def test_one_stretch_has_no_interval_and_is_judged_doubtful(simulator_rows):
    found = diagnose(simulator_rows(15), PLANT, MDP, 0)
    assert found.units == 1
    assert found.error_over_advantage_std == pytest.approx(0, abs=1e-9)
    assert found.correlation_with_advantage_interval is None
    assert found.verdict == "doubtful"


def test_rows_that_are_all_alike_have_no_numbers(simulator_rows):
    table = pd.concat([simulator_rows(1)] * 40, ignore_index=True).assign(segment=np.arange(40) // 20)
    found = diagnose(table, PLANT, MDP, 0)
    assert found.error_over_advantage_std is None
    assert found.correlation_with_advantage is None
    assert found.verdict == "doubtful"
