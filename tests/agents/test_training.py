import numpy as np
import pandas as pd
import pytest

from maglev_offline.agents.settings import EvaluationSettings
from maglev_offline.agents.training import train_block
from maglev_offline.mdp import Mdp


def train(world, seeds, prefill=None, algorithm="td3", **changes):
    settings = world.training.model_copy(update=changes)
    return train_block(algorithm, seeds, world.plant, world.mdp, settings, world.evaluation, prefill)


def rows(n=40, seed=1):
    rng = np.random.default_rng(seed)
    packed = rng.normal(size=(n, 9)).astype(np.float32)
    packed[:, 3] = rng.uniform(-1, 1, n)
    packed[:, 8] = 0.9
    return packed


@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_the_same_seeds_give_the_same_bits(world, algorithm):
    one, two = (train(world, [0, 1, 2], algorithm=algorithm) for _ in range(2))
    pd.testing.assert_frame_equal(one.curves, two.curves, check_exact=True)
    assert all(np.array_equal(one.last[name], two.last[name]) for name in one.last)


def test_the_evaluation_of_a_seed_does_not_depend_on_its_company_either(world):
    """At the real length and starts, where another rounding grows into another response."""
    real = world._replace(mdp=Mdp(), evaluation=EvaluationSettings(every_steps=120))
    alone, together = (train(real, seeds, block=4, steps=120).curves for seeds in ([2], [0, 1, 2, 3]))
    curve = together[together["seed"] == 2].reset_index(drop=True)
    pd.testing.assert_frame_equal(alone, curve, check_exact=True)


@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_a_seed_does_not_depend_on_its_company_or_place(world, algorithm):
    alone = train(world, [7], algorithm=algorithm)
    for company, place in (([7, 1, 2], 0), ([5, 6, 7], 2)):
        together = train(world, company, algorithm=algorithm)
        for name, value in alone.last.items():
            np.testing.assert_array_equal(value[0], together.last[name][place])
        curve = together.curves[together.curves["seed"] == 7].reset_index(drop=True)
        pd.testing.assert_frame_equal(alone.curves, curve, check_exact=True)


def test_evaluation_comes_before_the_first_update_and_then_on_a_grid(world):
    curves = train(world, [0, 1]).curves
    assert sorted(curves["env_step"].unique()) == [0, 60, 120]
    assert len(curves) == 6


def test_nothing_is_learned_during_the_exploratory_steps(world):
    curves = train(world, [0]).curves.set_index("env_step")
    assert curves.loc[0, "cost"] == curves.loc[60, "cost"]
    assert curves.loc[120, "cost"] != curves.loc[60, "cost"]


def test_arms_are_paired_they_differ_only_after_the_first_gradient_step(world):
    empty, filled = train(world, [0, 1]).curves, train(world, [0, 1], rows()).curves
    before = empty["env_step"] <= 60
    pd.testing.assert_frame_equal(empty[before], filled[before], check_exact=True)
    assert not np.array_equal(empty[~before]["cost"], filled[~before]["cost"])


def test_the_best_actor_is_the_one_with_the_least_cost_on_the_selection_starts(world):
    trained = train(world, [0], steps=300, exploratory_steps=60)
    best = trained.curves.loc[trained.curves["selection_cost"].idxmin()]
    from maglev_offline.agents.evaluation import judge, roll_out

    block = {name: np.repeat(value, world.training.block, axis=0) for name, value in trained.best.items()}
    response = roll_out(block, world.plant, world.mdp, world.evaluation)
    again = judge(response, block, world.plant, world.mdp, world.evaluation)
    assert again.loc[0, "selection_cost"] == pytest.approx(best["selection_cost"], rel=1e-9)


def test_ticks_count_every_step_of_every_seed_once(world):
    ticks = []
    train_block("ddpg", [0, 1], world.plant, world.mdp, world.training, world.evaluation, tick=ticks.append)
    assert sum(ticks) == 2 * world.training.steps


def test_held_exploratory_actions_are_held(world, monkeypatch):
    from maglev_offline.agents import training

    taken = []
    pack = training.pack
    monkeypatch.setattr(training, "pack", lambda seen, act, *rest: taken.append(act.copy()) or pack(seen, act, *rest))
    train(world, [0], exploratory_hold_ms=30.0)
    explored = np.array(taken)[:60, 0].reshape(-1, 3)
    assert (explored == explored[:, :1]).all()
    assert len(np.unique(explored[:, 0])) == 20
