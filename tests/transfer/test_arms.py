import pytest

from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.curate.recovery.settings import RecoverySettings
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.errors import RecipeError
from maglev_offline.recipe import parse_recipe
from maglev_offline.transfer.arms import SAME_IN_ALL_ARMS, plan_of
from maglev_offline.transfer.settings import BUILT_IN, ArmSettings, TransferSettings

CURATE, TRAINING = CurateSettings(), TrainingSettings()


def plan(name, **arms):
    settings = TransferSettings(arm={key: ArmSettings(**value) for key, value in arms.items()})
    return plan_of(name, settings, CURATE, TRAINING)


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_a_built_in_arm_learns_as_the_recipe_says(name):
    found = plan(name)
    assert found.training == TRAINING
    assert found.curate == (CURATE.model_copy(update={"balance": "none"}) if name == "uncurated" else None)


def test_an_arm_differs_in_what_it_says_and_in_nothing_else():
    found = plan("half", half={"curate": {"construction": "interpolated"}, "training": {"mixing_share": 0.5}})
    assert found.curate == CURATE.model_copy(update={"construction": "interpolated"})
    assert found.training == TRAINING.model_copy(update={"mixing_share": 0.5})


def test_a_table_within_a_table_is_changed_where_the_arm_says_so_and_nowhere_else():
    curate = CurateSettings(recovery=RecoverySettings(gap_std_m=5e-5))
    settings = TransferSettings(arm={"own": ArmSettings(curate={"recovery": {"law": "pid"}})})
    found = plan_of("own", settings, curate, TRAINING).curate
    assert found.recovery == curate.recovery.model_copy(update={"law": "pid"})


@pytest.mark.parametrize("key", SAME_IN_ALL_ARMS)
def test_what_makes_the_arms_comparable_cannot_differ(key):
    with pytest.raises(RecipeError, match=f"{key} must be the same in all arms"):
        plan("long", long={"training": {key: 1}})


@pytest.mark.parametrize(
    ("arm", "what"),
    [
        ({"training": {"mixing_shre": 0.5}}, "mixing_shre"),
        ({"training": {"mixing_share": 2}}, "mixing_share: Input should be less than or equal to 1"),
        ({"curate": {"construction": "magic"}}, "construction"),
    ],
)
def test_a_key_that_cannot_be_is_named_before_anything_is_run(arm, what):
    with pytest.raises(RecipeError, match=what) as raised:
        plan("odd", odd=arm)
    assert "nothing was run" in str(raised.value)


def test_an_unknown_arm_is_named_with_those_that_are_known():
    with pytest.raises(RecipeError, match=r"no arm 'prefil'.*random_policy"):
        plan("prefil")


@pytest.mark.parametrize(
    ("table", "what"),
    [
        ({"arms": ["empty", "prefil"]}, "there is no arm 'prefil'"),
        ({"arm": {"pid": {}}}, "'pid' is built in"),
        ({"arm": {"../up": {}}}, "names a folder"),
        ({"arm": {"odd": {"rows": "pid", "curate": {"construction": "raw"}}}}, "nothing to curate"),
        ({"arm": {"odd": {"rows": "thin air"}}}, "rows"),
        ({"arm": {"odd": {"training": {"mixing_shre": 0.5}}}}, "mixing_shre"),  # though no arms name it
        ({"control_periods_ms": [10, 2.5]}, "control_periods_ms.*whole multiple"),
        ({"control_periods_ms": [0]}, "control_periods_ms"),
    ],
)
def test_a_recipe_with_an_arm_or_a_period_that_cannot_be_is_refused(table, what):
    with pytest.raises(RecipeError, match=what):
        parse_recipe({"transfer": table}, "recipe.toml")
