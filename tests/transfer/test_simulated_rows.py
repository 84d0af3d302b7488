import numpy as np
import pytest

from maglev_offline.control.pid import PidGains, pid
from maglev_offline.curate.simulator import hold
from maglev_offline.mdp import STATE_NAMES, Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.streams import stream
from maglev_offline.transfer.simulated_rows import RandomPolicy, simulated_rows

PLANT = Plant()
MDP = Mdp(episode_duration_s=0.1, start_gap_m=(0.006, 0.010))
STATE, NEXT = list(STATE_NAMES), [f"next_{name}" for name in STATE_NAMES]


def rows(count=25, mdp=MDP, seed=0, hold_decisions=1):
    policy = RandomPolicy(stream(seed, "actions"), mdp.voltage_limit_v, hold_decisions)
    return simulated_rows(PLANT, mdp, policy, count, "random_policy", seed)


def test_without_a_random_force_each_row_is_what_the_simulator_says():
    table = rows()
    held = hold(PLANT, MDP, table[STATE].to_numpy(), table["voltage_deviation_v"].to_numpy())
    np.testing.assert_allclose(table[NEXT], held.next_state, atol=1e-12)
    np.testing.assert_allclose(table["cost"], held.cost)


def test_rows_of_an_episode_follow_each_other_and_the_last_one_is_cut():
    table = rows(count=25)
    assert table.groupby("segment").size().tolist() == [10, 10, 5]
    whole = table[table["segment"] == 0]
    np.testing.assert_array_equal(whole[NEXT].to_numpy()[:-1], whole[STATE].to_numpy()[1:])
    assert whole["truncated"].tolist() == [False] * 9 + [True]
    assert whole["t"].diff().dropna().dt.total_seconds().to_list() == pytest.approx([0.01] * 9)


def test_an_action_is_held_for_as_many_decisions_as_it_should():
    voltage = rows(count=10, hold_decisions=5)["voltage_deviation_v"]
    assert voltage.nunique() == 2
    assert voltage[:5].nunique() == 1


def test_a_random_force_acts_where_the_process_has_one():
    noisy = MDP.model_copy(update={"force_noise_std_n": 500.0})
    table = rows(mdp=noisy)
    held = hold(PLANT, noisy, table[STATE].to_numpy(), table["voltage_deviation_v"].to_numpy())
    assert not np.allclose(table[NEXT], held.next_state, atol=1e-9)


def test_an_episode_that_ends_at_contact_has_no_rows_behind_it():
    ends = MDP.model_copy(update={"terminate_on_contact": True, "contact_penalty": 5.0, "episode_duration_s": 0.5})
    table = rows(count=100, mdp=ends, hold_decisions=50)
    last = table.groupby("segment").tail(1)
    assert table["terminated"].any()
    assert (table[table["terminated"]].index.isin(last.index)).all()
    assert (table["discount"] == np.where(table["terminated"], 0.0, ends.discount)).all()
    assert len(table) == 100
    assert not table.duplicated(["segment", "step"]).any()


def test_the_same_seed_gives_the_same_rows_and_another_one_others():
    policy = pid(PidGains(), 200.0)
    one, same, other = (simulated_rows(PLANT, MDP, policy, 20, "pid", seed) for seed in (1, 1, 2))
    assert one.equals(same)
    assert not one.equals(other)
