import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.curate.measures import visited
from maglev_offline.curate.measures.visited import STARTS, share_near, visited_states
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

SCALE = np.array([1.0, 2.0, 4.0])


def test_both_policies_are_asked_at_each_decision_of_an_episode_from_each_start():
    mdp = Mdp()
    found = visited_states(Plant(), mdp)
    assert set(found) == {"lqr", "pid"}
    for states in found.values():
        assert states.shape == (STARTS * mdp.decisions_per_episode, 3)
        first = states.reshape(mdp.decisions_per_episode, STARTS, 3)[0]
        np.testing.assert_allclose(first[:, 0] + Plant().set_point_m, np.linspace(*mdp.start_gap_m, STARTS))
        np.testing.assert_allclose(first[:, 1:], 0, atol=1e-12)


def test_the_lqr_ends_near_the_set_point():
    last = visited_states(Plant(), Mdp())["lqr"][-STARTS:]
    assert np.abs(last[:, 0]).max() < 5e-4


@given(st.integers(0, 100), st.sampled_from([3, 7, 1000]))
@settings(max_examples=20)
def test_the_share_is_that_of_a_comparison_of_all_with_all_however_it_is_cut(seed, chunk):
    rng = np.random.default_rng(seed)
    states, there = rng.normal(0, SCALE, (40, 3)), rng.normal(0, SCALE, (25, 3))
    away = np.linalg.norm((there[:, None] - states[None]) / SCALE, axis=2).min(axis=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(visited, "CHUNK", chunk)
        assert share_near(there, states, SCALE, 0.5) == (away < 0.5).mean()


def test_nothing_is_near_where_there_is_no_row():
    assert share_near(np.zeros((4, 3)), np.empty((0, 3)), SCALE) == 0
