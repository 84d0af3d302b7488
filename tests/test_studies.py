"""Slow studies of learning: minutes each, run by `make study`, not by CI."""

from pathlib import Path

import pytest

from maglev_offline.agents.stage import Arm, load_curves, train_arms
from maglev_offline.control.reference import classical_reference_cost
from maglev_offline.recipe import load_recipe
from maglev_offline.workspace import Workspace

QUICKSTART = Path(__file__).parents[1] / "pipelines" / "quickstart.toml"


@pytest.mark.study
@pytest.mark.parametrize("algorithm", ["ddpg", "td3"])
def test_an_empty_buffer_learns_to_hold_the_gap_in_twenty_thousand_decisions(tmp_path, algorithm):
    """16 seeds of the quick start: every run reaches the threshold, and they regulate, for less than the LQR."""
    recipe = load_recipe(QUICKSTART)
    world = recipe.world._replace(training=recipe.training.model_copy(update={"seeds": 16}))
    arm = Arm(algorithm, "empty", None)
    folders, _ = train_arms(Workspace(tmp_path), [arm], world, jobs=2)
    curves = load_curves(folders[arm])
    last = curves[curves["env_step"] == recipe.training.steps]
    lqr = classical_reference_cost(recipe.plant, recipe.mdp, recipe.evaluation.start_gaps_m)["lqr_held"].mean()
    print(last[["seed", "cost", "worst_error_m", "settling_time_s"]].to_string())
    assert not last["diverged"].any()
    assert (curves.groupby("seed")["cost"].min() < recipe.transfer.threshold_over_lqr * lqr).all()
    assert last["cost"].median() < 0.8 * lqr
    assert (last["worst_error_m"] <= 0.5e-3).mean() >= 0.9
