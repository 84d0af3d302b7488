import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.curate.constructions.raw import raw_rows
from maglev_offline.curate.pairs import pairs_of
from maglev_offline.curate.transitions import NEXT_STATE, STATE, unusable
from maglev_offline.mdp import Mdp, row_cost
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()


def make(*segments, mdp=MDP):
    return raw_rows(pairs_of(pd.concat(segments, ignore_index=True), PLANT), PLANT, mdp)


def test_the_next_state_is_the_next_sample_of_the_segment(samples_of):
    table = make(samples_of([0.007, 0.009, 0.010], velocity_m_s=[0.1, 0.2, 0.3], current_a=[19, 20, 21]))
    equilibrium = PLANT.equilibrium(0.008)
    assert len(table) == 2
    np.testing.assert_allclose(table["gap_error_m"], [-0.001, 0.001], atol=1e-15)
    np.testing.assert_allclose(table["next_gap_error_m"], [0.001, 0.002], atol=1e-15)
    np.testing.assert_array_equal(table["next_gap_velocity_m_s"], [0.2, 0.3])
    np.testing.assert_allclose(table["next_current_error_a"], np.array([20, 21]) - equilibrium.current_a)
    np.testing.assert_allclose(table["duration_s"], [0.1, 0.1])


@pytest.mark.parametrize("border", [{"segment": 1}, {"point": "P2"}, {"log_id": "log-b"}])
def test_no_transition_crosses_a_border(samples_of, border):
    table = make(samples_of([0.001, 0.002]), samples_of([0.011, 0.012], **border))
    np.testing.assert_allclose(table["gap_error_m"] + 0.008, [0.001, 0.011])
    np.testing.assert_allclose(table["next_gap_error_m"] + 0.008, [0.002, 0.012])


def test_a_segment_of_one_sample_gives_no_transition(samples_of):
    assert len(make(samples_of([0.008]), samples_of([0.009], segment=1))) == 0


def test_the_order_of_the_rows_of_the_samples_does_not_matter(samples_of):
    samples = pd.concat([samples_of([0.007, 0.008, 0.009]), samples_of([0.01, 0.011], point="P2")])
    shuffled = samples.sample(frac=1, random_state=1)
    pd.testing.assert_frame_equal(make(samples), make(shuffled))


def test_the_cost_is_that_of_the_logged_state_and_voltage(samples_of):
    mdp = Mdp(contact_penalty=0.0)
    table = make(samples_of([0.007, 0.009], velocity_m_s=0.05, voltage_v=30.0), mdp=mdp)
    z = np.array([[-0.001, 0.05, 20.0 - PLANT.equilibrium(0.008).current_a]])
    v = np.array([30.0 - PLANT.equilibrium(0.008).voltage_v])
    np.testing.assert_allclose(table["voltage_deviation_v"], v)
    np.testing.assert_allclose(table["cost"], row_cost(mdp, z, v), rtol=1e-12)


def test_both_states_refer_to_the_set_point_of_the_row(samples_of):
    table = make(samples_of([0.008, 0.008, 0.008], set_point_m=[0.008, 0.009, 0.009]))
    np.testing.assert_allclose(table["gap_error_m"], [0, -0.001], atol=1e-15)
    np.testing.assert_allclose(table["next_gap_error_m"], [0, -0.001], atol=1e-15)
    at = [PLANT.equilibrium(gap).current_a for gap in (0.008, 0.009)]
    np.testing.assert_allclose(table["next_current_error_a"], 20.0 - np.array(at))


def test_only_contact_terminates_and_only_where_the_process_ends_on_it(samples_of):
    touching = samples_of([0.012, 0.014, 0.016], contact=[False, False, True])
    ending = make(touching, mdp=Mdp(terminate_on_contact=True, contact_penalty=3.0))
    going_on = make(touching, mdp=Mdp(terminate_on_contact=False, contact_penalty=3.0))
    assert ending["terminated"].tolist() == [False, True]
    assert ending["truncated"].tolist() == [False, False]
    assert going_on["terminated"].tolist() == [False, False]
    assert going_on["truncated"].tolist() == [False, True]
    free = make(touching, mdp=Mdp(contact_penalty=0.0))
    np.testing.assert_allclose(going_on["cost"] - free["cost"], [0, 3.0], atol=1e-12)


def test_the_last_transition_of_each_segment_is_truncated(samples_of):
    table = make(samples_of([0.008] * 3), samples_of([0.008] * 2, segment=1), samples_of([0.008] * 2, point="P2"))
    assert table["truncated"].tolist() == [False, True, True, True]
    assert not table["terminated"].any()


def test_rows_that_cannot_be_used_get_a_reason_each(samples_of):
    mdp = Mdp(voltage_limit_v=100)
    limit = PLANT.equilibrium(0.008).voltage_v + 100
    gap = [0.008, 0.008, 0.008, np.nan, 0.008, 0.008, 0.008]
    voltage = [limit - 1e-9, limit + 0.01, limit + 0.01, 24, 24, np.nan, 24]
    table = make(samples_of(gap, voltage_v=voltage), mdp=mdp)
    # The third row is beyond the limit and runs into a hole as well: it counts once.
    reasons = ["", "voltage_outside_limit", "not_finite", "not_finite", "", "not_finite"]
    assert unusable(table, mdp).tolist() == reasons


def test_a_missing_set_point_makes_a_row_unusable(samples_of):
    table = make(samples_of([0.008] * 3, set_point_m=[0.008, np.nan, 0.008]))
    assert unusable(table, MDP).tolist() == ["", "not_finite"]


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.sampled_from("ab"), st.sampled_from("PQ"), st.integers(1, 5)), min_size=1, max_size=8))
def test_every_segment_gives_one_transition_less_than_it_has_samples(samples_of, layout):
    segments = [
        samples_of(0.005 + 0.0001 * (10 * k + np.arange(n)), log_id=log, point=point, segment=k)
        for k, (log, point, n) in enumerate(layout)
    ]
    table = make(*segments)
    assert len(table) == sum(n - 1 for _, _, n in layout)
    assert table["truncated"].sum() == sum(n > 1 for _, _, n in layout)
    np.testing.assert_allclose(table["next_gap_error_m"] - table["gap_error_m"], 0.0001)


def test_a_transition_names_the_row_it_came_from(samples_of):
    table = make(samples_of([0.007, 0.008, 0.009], log_id="log-b", point="P7", segment=4))
    assert table[["log_id", "point", "segment", "step"]].to_numpy().tolist() == [
        ["log-b", "P7", 4, 0],
        ["log-b", "P7", 4, 1],
    ]
    assert str(table["t"].dt.tz) == "UTC"
    assert [*STATE, *NEXT_STATE] == [c for c in table.columns if c in {*STATE, *NEXT_STATE}]
