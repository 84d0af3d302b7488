import pytest

from maglev_offline import pipeline
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.progress import SILENT
from maglev_offline.recipe import Recipe
from maglev_offline.workspace import Workspace


def test_the_algorithms_are_those_asked_for_or_those_of_the_recipe():
    recipe = Recipe(training=TrainingSettings(algorithms=("td3",)))
    assert pipeline.algorithms(recipe, None) == ("td3",)
    assert pipeline.algorithms(recipe, "ddpg") == ("ddpg",)


def test_an_algorithm_that_is_not_known_or_none_at_all_is_refused():
    with pytest.raises(InputError, match="no algorithm 'sac'"):
        pipeline.algorithms(Recipe(), "sac")
    with pytest.raises(InputError, match="trains no algorithm"):
        pipeline.algorithms(Recipe(training=TrainingSettings(algorithms=())), None)


def test_an_arm_that_is_not_known_is_refused(tmp_path):
    with pytest.raises(InputError, match="no arm 'full'"):
        pipeline.train(Recipe(), Workspace(tmp_path), None, "full", 1, SILENT)


def test_the_road_needs_a_log_that_can_be_used(tmp_path):
    (tmp_path / "bad.mcap").write_text("no MCAP")
    with pytest.raises(ArtefactError, match="none of the logs could be used"):
        pipeline.run(Recipe(), Workspace(tmp_path / "w"), [tmp_path / "bad.mcap"], 1, SILENT)
