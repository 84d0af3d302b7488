import numpy as np
import pandas as pd
import pytest

from maglev_offline.agents import training as loop
from maglev_offline.agents.checkpoint import Checkpoint
from maglev_offline.agents.engine import make_learner
from maglev_offline.agents.settings import EvaluationSettings
from maglev_offline.agents.training import train_block
from maglev_offline.mdp import Mdp


@pytest.fixture
def train(engine):
    """Train seeds in a world with changes to its training, on each engine in turn."""

    def run(world, seeds, prefill=None, algorithm="td3", checkpoint=None, threads=1, **changes):
        settings = world.training.model_copy(update=changes)
        return train_block(
            algorithm, seeds, world.plant, world.mdp, settings, world.evaluation, prefill,
            engine=engine, checkpoint=checkpoint, threads=threads,
        )  # fmt: skip

    return run


def same(one, two):
    pd.testing.assert_frame_equal(one.curves, two.curves, check_exact=True)
    pd.testing.assert_frame_equal(one.regulation, two.regulation, check_exact=True)
    for nets in ("last", "best"):
        for name, value in getattr(one, nets).items():
            np.testing.assert_array_equal(value, getattr(two, nets)[name])
    assert one.diverged_at == two.diverged_at


@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_the_same_seeds_give_the_same_bits(train, world, algorithm):
    one, two = (train(world, [0, 1, 2], algorithm=algorithm) for _ in range(2))
    pd.testing.assert_frame_equal(one.curves, two.curves, check_exact=True)
    assert all(np.array_equal(one.last[name], two.last[name]) for name in one.last)


def test_the_evaluation_of_a_seed_does_not_depend_on_its_company_either(train, world):
    """At the real length and starts, where another rounding grows into another response."""
    real = world._replace(mdp=Mdp(), evaluation=EvaluationSettings(every_steps=120))
    alone, together = (train(real, seeds, block=4, steps=120).curves for seeds in ([2], [0, 1, 2, 3]))
    curve = together[together["seed"] == 2].reset_index(drop=True)
    pd.testing.assert_frame_equal(alone, curve, check_exact=True)


@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_a_seed_does_not_depend_on_its_company_or_place(train, world, algorithm):
    alone = train(world, [7], algorithm=algorithm)
    for company, place in (([7, 1, 2], 0), ([5, 6, 7], 2)):
        together = train(world, company, algorithm=algorithm)
        for name, value in alone.last.items():
            np.testing.assert_array_equal(value[0], together.last[name][place])
        curve = together.curves[together.curves["seed"] == 7].reset_index(drop=True)
        pd.testing.assert_frame_equal(alone.curves, curve, check_exact=True)


def test_evaluation_comes_before_the_first_update_and_then_on_a_grid(train, world):
    curves = train(world, [0, 1]).curves
    assert sorted(curves["env_step"].unique()) == [0, 60, 120]
    assert len(curves) == 6


def test_nothing_is_learned_during_the_exploratory_steps(train, world):
    curves = train(world, [0]).curves.set_index("env_step")
    assert curves.loc[0, "cost"] == curves.loc[60, "cost"]
    assert curves.loc[120, "cost"] != curves.loc[60, "cost"]


def test_arms_are_paired_they_differ_only_after_the_first_gradient_step(train, world, prefilled_rows):
    empty, filled = train(world, [0, 1]).curves, train(world, [0, 1], prefilled_rows).curves
    before = empty["env_step"] <= 60
    pd.testing.assert_frame_equal(empty[before], filled[before], check_exact=True)
    assert not np.array_equal(empty[~before]["cost"], filled[~before]["cost"])


def test_the_best_actor_is_the_one_with_the_least_cost_on_the_selection_starts(train, world):
    trained = train(world, [0], steps=300, exploratory_steps=60)
    best = trained.curves.loc[trained.curves["selection_cost"].idxmin()]
    from maglev_offline.agents.evaluation import judge, roll_out

    block = {name: np.repeat(value, world.training.block, axis=0) for name, value in trained.best.items()}
    response = roll_out(block, world.plant, world.mdp, world.evaluation.all_starts_m)
    again = judge(response, block, world.plant, world.mdp, world.evaluation)
    assert again.loc[0, "selection_cost"] == pytest.approx(
        best["selection_cost"], rel=1e-6
    )  # the engines round otherwise


def test_ticks_count_every_step_of_every_seed_once(world):
    ticks = []
    train_block("ddpg", [0, 1], world.plant, world.mdp, world.training, world.evaluation, tick=ticks.append)
    assert sum(ticks) == 2 * world.training.steps


def test_each_evaluation_is_shown_as_it_comes(world):
    seen = []
    args = ("ddpg", [0, 1], world.plant, world.mdp, world.training, world.evaluation)
    curves = train_block(*args, see=seen.append).curves
    assert [table["env_step"].unique().tolist() for table in seen] == [[0], [60], [120]]
    shown = pd.concat(seen).sort_values(["seed", "env_step"], ignore_index=True)
    pd.testing.assert_frame_equal(shown, curves)


def test_the_evaluation_before_the_first_update_is_that_of_the_initial_weights(train, world):
    trained = train(world, [0], steps=61, exploratory_steps=60)
    first = trained.curves.iloc[0]
    settings = world.training
    fresh = make_learner("torch", "td3", [0], world.plant, world.mdp, settings)
    from maglev_offline.agents.evaluation import judge

    response = fresh.responses(world.evaluation.all_starts_m)
    again = judge(response, fresh.actors(), world.plant, world.mdp, world.evaluation)
    assert first["env_step"] == 0
    assert first["cost"] == pytest.approx(again.loc[0, "cost"], rel=1e-4)


class Stopped(Exception):
    """The run was interrupted."""


@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
@pytest.mark.parametrize("saves", [1, 2, 3])
def test_a_run_that_was_stopped_ends_in_the_same_bits(train, world, prefilled_rows, tmp_path, algorithm, saves):
    world = world._replace(
        evaluation=world.evaluation.model_copy(update={"every_steps": 40}),
        mdp=world.mdp.model_copy(update={"force_noise_std_n": 100.0}),
    )
    changes = {"checkpoint_every": 1, "steps": 200, "n_step": 2, "batch_norm_actor": True, "algorithm": algorithm}

    class Stopping(Checkpoint):
        def save(self, step, *rest):
            super().save(step, *rest)
            if step == 40 * saves:
                raise Stopped

    with pytest.raises(Stopped):
        train(world, [0, 1], prefilled_rows, checkpoint=Stopping(tmp_path, "mark", 2), **changes)
    again = Checkpoint(tmp_path, "mark", 2)
    assert again.load(1).step == 40 * saves
    same(
        train(world, [0, 1], prefilled_rows, checkpoint=again, **changes),
        train(world, [0, 1], prefilled_rows, **changes),
    )


def test_a_run_saves_every_so_many_evaluations_and_not_at_its_end(train, world, tmp_path):
    world = world._replace(evaluation=world.evaluation.model_copy(update={"every_steps": 30}))
    saved = []

    class Noting(Checkpoint):
        def save(self, step, state, rows):
            saved.append((step, len(rows)))

    train(world, [0], checkpoint=Noting(tmp_path, "mark", 1), steps=240, checkpoint_every=2)
    assert saved == [(60, 60), (120, 60), (180, 60)]


def test_a_seed_that_diverges_is_marked_at_its_step_and_kept_and_the_others_go_on(world, monkeypatch):
    """A critic of seed 1 holds no number from step 130 on."""
    args = (world.plant, world.mdp, world.training.model_copy(update={"steps": 240}), world.evaluation)
    healthy = train_block("td3", [0, 1, 2], *args)

    def spoiling(*given, **also):
        learner = make_learner(*given, **also)
        advance = learner.advance

        def spoil(steps):
            advance(steps)
            if learner.step == 130:
                state = learner.state()
                state["critic.b3"][0, 1] = np.nan
                learner.restore(state, learner.new_rows())

        learner.advance = spoil
        return learner

    monkeypatch.setattr(loop, "make_learner", spoiling)
    monkeypatch.setattr(loop, "WATCH_EVERY", 10)
    trained = train_block("td3", [0, 1, 2], *args)
    assert trained.diverged_at == {1: 130}
    marks = trained.curves.pivot(index="seed", columns="env_step", values="diverged")
    assert marks.loc[1].tolist() == [False, False, False, True, True]
    assert not marks.loc[[0, 2]].to_numpy().any()
    assert np.isfinite(trained.curves["cost"]).all()
    others = trained.curves["seed"] != 1
    pd.testing.assert_frame_equal(trained.curves[others], healthy.curves[others], check_exact=True)


def test_critics_that_explode_are_marked_and_the_run_ends_all_the_same(train, world):
    trained = train(world, [0, 1], critic_learning_rate=1e4, final_learning_rate_fraction=1.0)
    assert trained.diverged_at == {0: 120, 1: 120}
    assert len(trained.curves) == 6
    assert trained.curves["diverged"].tolist() == [False, False, True] * 2
    assert np.isfinite(trained.curves["cost"]).all()


def test_a_seed_that_has_diverged_stays_marked_though_its_networks_recover(world, monkeypatch):
    from maglev_offline.agents import record

    looks = iter([[False, True], [False, False], [False, False]])
    monkeypatch.setattr(record, "diverged", lambda *_: np.array(next(looks)))
    monkeypatch.setattr(loop, "WATCH_EVERY", 40)
    trained = train_block("td3", [4, 5], world.plant, world.mdp, world.training.model_copy(update={"steps": 120}),
                          world.evaluation.model_copy(update={"every_steps": 40}))  # fmt: skip
    assert trained.diverged_at == {5: 40}
    assert trained.curves.set_index("seed").loc[5, "diverged"].tolist() == [False, True, True, True]


@pytest.mark.parametrize("threads", [2, 5])
def test_any_number_of_threads_gives_the_same_bits(train, world, threads):
    same(train(world, [0, 1, 2], threads=threads), train(world, [0, 1, 2]))
