import pytest
from pydantic import ValidationError

from maglev_offline.agents.settings import EvaluationSettings, TrainingSettings
from maglev_offline.agents.stage import World
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.transfer.periods import decays_resized, settings_at, workspace_at, world_at
from maglev_offline.transfer.settings import ArmSettings, TransferSettings
from maglev_offline.workspace import Workspace

WORLD = World(
    Plant(), Mdp(), TrainingSettings(steps=20_000, exploratory_steps=1_000), EvaluationSettings(every_steps=500)
)


@pytest.mark.parametrize("period_ms", [1, 5, 10, 20])
def test_a_run_has_as_many_seconds_and_evaluations_at_every_period(period_ms):
    there = world_at(WORLD, period_ms)
    assert there.training.steps * period_ms == 20_000 * 10
    assert there.training.exploratory_steps * period_ms == 1_000 * 10
    assert there.training.steps // there.evaluation.every_steps == 40


def test_costs_are_discounted_as_fast_in_seconds():
    there = world_at(WORLD, 5)
    assert there.mdp.discount**2 == pytest.approx(WORLD.mdp.discount)


def test_what_does_not_count_decisions_stays():
    there = world_at(WORLD, 1)
    assert there.training.model_copy(update={"steps": 20_000, "exploratory_steps": 1_000}) == WORLD.training
    assert there.plant == WORLD.plant


def test_other_periods_may_end_sooner_and_have_fewer_seeds():
    settings = TransferSettings(other_periods_experience_share=0.5, other_periods_seeds=4)
    there = world_at(WORLD, 5, settings)
    assert there.training.steps == 20_000
    assert there.training.exploratory_steps == 2_000
    assert there.evaluation.every_steps == 1_000
    assert there.training.seeds == 4
    few = WORLD._replace(training=WORLD.training.model_copy(update={"seeds": 2}))
    assert world_at(few, 5, settings).training.seeds == 2


def test_a_period_that_the_plant_step_does_not_divide_is_refused():
    with pytest.raises(ValidationError, match="whole multiple"):
        world_at(WORLD, 2.5)


def test_an_arms_own_numbers_of_decisions_grow_too():
    arm = ArmSettings(training={"prefill_decay_steps": 1000, "mixing_share": 0.5})
    found = settings_at(TransferSettings(arm={"decaying": arm}, control_periods_ms=(1,)), WORLD, 1)
    assert found.arm["decaying"].training == {"prefill_decay_steps": 10_000, "mixing_share": 0.5}
    assert found.control_periods_ms == ()


def test_parts_of_the_rows_are_asked_about_at_the_recipes_own_period_alone():
    asked = TransferSettings(attribution=("logs",), control_periods_ms=(1,))
    assert settings_at(asked, WORLD, 1).attribution == ()


def test_the_workspace_of_a_period_sees_the_samples(tmp_path):
    workspace = Workspace(tmp_path)
    workspace.path("samples", "log").mkdir(parents=True)
    for _ in range(2):
        there = workspace_at(workspace, 5.0)
    assert there.root == tmp_path / "periods" / "5ms"
    assert there.path("samples", "log").is_dir()


def test_a_shorter_run_decays_sooner():
    arms = {"decaying": ArmSettings(training={"prefill_decay_steps": 1000}), "plain": ArmSettings()}
    training = TrainingSettings(steps=20_000, prefill_decay_steps=500)
    short, settings = decays_resized(training, TransferSettings(arm=arms), 0.1)
    assert short == training.model_copy(update={"prefill_decay_steps": 50})
    assert settings.arm == {"decaying": ArmSettings(training={"prefill_decay_steps": 100}), "plain": ArmSettings()}
