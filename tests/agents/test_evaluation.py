import numpy as np
import pytest

from maglev_offline.agents.evaluation import PolicyFeedback, judge, regulation, roll_out
from maglev_offline.agents.networks import init_actor, stack
from maglev_offline.control.lqi import lqr_for_mdp
from maglev_offline.control.reference import classical_reference_cost
from maglev_offline.env import SuspensionBatch
from maglev_offline.streams import stream


@pytest.fixture
def actor():
    net = stack([init_actor(stream(seed, "actor weights"), (8, 8), 1.0, False) for seed in range(3)])
    return {name: value.numpy() for name, value in net.items()}


def evaluate(actor, plant, mdp, evaluation):
    return judge(roll_out(actor, plant, mdp, evaluation.all_starts_m), actor, plant, mdp, evaluation)


def linear_actor(world):
    """An actor that is the LQR while its tanh is nearly linear: pairs of ReLUs carry the state through."""
    gain = lqr_for_mdp(world.plant, world.mdp, None).gain[:3] * world.mdp.state_scale / world.mdp.voltage_limit_v
    split = np.hstack([np.eye(3), -np.eye(3)])
    net = {
        "w1": split,
        "b1": np.zeros((1, 6)),
        "w2": np.eye(6),
        "b2": np.zeros((1, 6)),
        "w3": split.T @ gain[:, None],
        "b3": np.zeros((1, 1)),
    }
    return {name: value[None].astype(np.float32) for name, value in net.items()}


def test_an_actor_that_is_the_lqr_scores_about_what_the_lqr_scores(world):
    mdp = world.mdp.model_copy(update={"episode_duration_s": 0.5})
    small = world.evaluation.model_copy(
        update={"start_gaps_m": (0.0078, 0.0081), "reference_start_gap_m": 0.0081, "selection_gaps_m": (0.0079,)}
    )
    table = evaluate(linear_actor(world), world.plant, mdp, small)
    reference = classical_reference_cost(world.plant, mdp, small.start_gaps_m)["lqr_held"].mean()
    assert table.loc[0, "cost"] == pytest.approx(reference, rel=0.02)
    assert table.loc[0, "worst_error_m"] < 1e-5


def test_the_cost_is_that_of_the_environment_that_the_agent_trains_in(world, actor):
    starts = np.array(world.evaluation.start_gaps_m)
    env = SuspensionBatch(world.plant, world.mdp, 3 * len(starts))
    env.reset(np.tile(starts, 3))
    policy, total = PolicyFeedback(actor, world.mdp), 0.0
    for _ in range(world.mdp.decisions_per_episode):
        v, _ = policy.control(env.deviation(), None, 0.01)
        _, cost, _ = env.step(v / world.mdp.voltage_limit_v)
        total = total + cost
    table = evaluate(actor, world.plant, world.mdp, world.evaluation)
    np.testing.assert_allclose(table["cost"], total.reshape(3, -1).mean(axis=1), rtol=1e-9)
    np.testing.assert_array_equal(table["return"], -table["cost"])


def test_an_actor_that_diverged_is_marked_and_still_scored(world, actor):
    actor["w1"][1, 0, 0] = np.nan
    table = evaluate(actor, world.plant, world.mdp, world.evaluation)
    assert table["diverged"].tolist() == [False, True, False]
    assert np.isfinite(table["cost"]).all()


def test_regulation_starts_at_the_reference_gap_with_the_current_of_the_set_point(world, actor):
    response = roll_out(actor, world.plant, world.mdp, world.evaluation.all_starts_m)
    table = regulation(response, [4, 5, 6], world.evaluation)
    first = table[table["t_s"] == 0]
    assert first["seed"].tolist() == [4, 5, 6]
    assert (first["gap_m"] == 0.015).all()
    np.testing.assert_allclose(first["current_a"], world.plant.equilibrium().current_a)
    assert len(table) == 3 * round(world.mdp.episode_duration_s / world.mdp.plant_step_s)


def test_the_worst_error_is_the_largest_over_the_reported_starts_and_the_end_of_the_episode(world, actor):
    response = roll_out(actor, world.plant, world.mdp, world.evaluation.all_starts_m)
    starts = len(world.evaluation.start_gaps_m) + len(world.evaluation.selection_gaps_m)
    error = np.abs(response.gap_m - world.plant.set_point_m)
    last = error[-round(0.2 * len(error)) :].max(axis=0).reshape(3, starts)
    table = judge(response, actor, world.plant, world.mdp, world.evaluation)
    np.testing.assert_allclose(table["worst_error_m"], last[:, : len(world.evaluation.start_gaps_m)].max(axis=1))


def test_regulation_shows_the_very_responses_that_are_judged(world, actor):
    response = roll_out(actor, world.plant, world.mdp, world.evaluation.all_starts_m)
    starts = [*world.evaluation.start_gaps_m, *world.evaluation.selection_gaps_m]
    place = starts.index(world.evaluation.reference_start_gap_m)
    table = regulation(response, [4, 5], world.evaluation)
    for seed in (0, 1):
        rows = table[table["seed"] == 4 + seed]
        column = seed * len(starts) + place
        np.testing.assert_array_equal(rows["gap_m"], response.gap_m[:-1, column])
        np.testing.assert_array_equal(rows["voltage_v"], response.voltage_v[:, column])
