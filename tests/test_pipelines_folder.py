from pathlib import Path
from typing import get_args

import pytest

from maglev_offline.curate.settings import ConstructionName
from maglev_offline.ingest.inputs import find_logs
from maglev_offline.recipe import load_recipe
from maglev_offline.transfer.arms import plan_of

FOLDER = Path(__file__).parents[1] / "pipelines"
RECIPES = sorted(FOLDER.glob("*.toml"))


def test_the_recipes_are_there():
    assert [path.stem for path in RECIPES] == ["changsha", "cure", "levitator", "quickstart", "study"]


@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
def test_every_recipe_loads_and_says_what_it_is(path):
    recipe = load_recipe(path)
    assert recipe.name == path.stem
    assert recipe.description


@pytest.mark.parametrize("name", ["changsha", "cure", "quickstart", "study"])
def test_recipes_on_bundled_logs_find_them(name):
    assert len(find_logs(load_recipe(FOLDER / f"{name}.toml").logs, relative_to=FOLDER)) == 3


@pytest.fixture(scope="module")
def changsha():
    return load_recipe(FOLDER / "changsha.toml")


def test_the_published_plant(changsha):
    plant = changsha.plant
    assert (plant.mass_kg, plant.coil_turns, plant.pole_area_m2, plant.resistance_ohm) == (700, 450, 0.024, 1.2)
    assert plant.set_point_m == 0.008


def test_the_published_process(changsha):
    mdp = changsha.mdp
    assert (mdp.plant_step_ms, mdp.control_period_ms, mdp.integrator) == (1, 1, "euler")
    assert mdp.decisions_per_episode == 500
    assert mdp.force_noise_std_n**2 == 2.5e5
    assert mdp.start_gap_m == (0.015, 0.015)


def test_the_published_pid(changsha):
    gains = changsha.control.pid
    assert (gains.kp, gains.kd, gains.ki) == (3100, 310, 300)


def test_the_published_learning(changsha):
    training = changsha.training
    assert training.algorithms == ("ddpg", "td3")
    assert training.hidden == (40, 40)
    assert training.batch_norm_actor
    assert (training.batch_size, training.buffer_capacity) == (100, 1_000_000)
    assert (training.exploration_std, training.smoothing_std, training.smoothing_clip) == (0.1, 0.2, 0.5)
    assert (training.policy_delay, training.steps, training.exploratory_steps) == (2, 500_000, 10_000)


def test_the_published_number_of_logged_rows(changsha):
    assert changsha.curate.target_rows == 10_000
    assert changsha.prefill.rows is None


def test_the_study_has_every_construction_every_control_and_cures_of_logs_alone():
    recipe = load_recipe(FOLDER / "study.toml")
    arms = {name: recipe.transfer.known_arms[name] for name in recipe.transfer.arms}
    made = {arm.curate.get("construction", recipe.curate.construction) for arm in arms.values() if arm.rows == "log"}
    assert made == set(get_args(ConstructionName))
    assert {"empty", "prefill", "uncurated", "shuffled", "random_policy", "pid"} <= set(arms)
    assert not any(arm.curate.get("construction") == "simulated_next" for arm in arms.values() if arm.cure)
    assert recipe.transfer.control_periods_ms == (10, 5, 1)
    for name in arms:
        plan_of(name, recipe.transfer, recipe.curate, recipe.training)


def test_the_cure_is_that_of_the_study_on_seeds_that_did_not_choose_it():
    study, cure = (load_recipe(FOLDER / f"{name}.toml") for name in ("study", "cure"))
    assert not set(cure.training.seed_list) & set(study.training.seed_list)
    chosen = study.transfer.arm["half_reconstructed"]
    assert chosen.curate["construction"] == cure.curate.construction
    assert chosen.training == cure.transfer.arm["half_reconstructed"].training
    alike = {"seeds", "first_seed"}
    assert cure.training.model_dump(exclude=alike) == study.training.model_dump(exclude=alike)
    assert (cure.mdp, cure.evaluation) == (study.mdp, study.evaluation)
