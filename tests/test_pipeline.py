import pytest

from maglev_offline import pipeline
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.errors import InputError
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


def test_the_road_ends_at_once_where_no_log_can_be_used(tmp_path):
    (tmp_path / "bad.mcap").write_text("no MCAP")
    run = pipeline.run(Recipe(), Workspace(tmp_path / "w"), [tmp_path / "bad.mcap", tmp_path / "none.mcap"], 1, SILENT)
    assert run.refused
    assert run.stages == []
    assert run.plain()["report"] is None
    assert [log["status"] for log in run.plain()["ingest"]["logs"]] == ["refused", "refused"]
    assert run.lines() == ["None of the logs could be used: there is nothing to go on with."]


@pytest.mark.parametrize("asked", ["TD3", "Td3", "td3"])
def test_an_algorithm_may_be_written_in_capitals(asked):
    assert pipeline.algorithms(Recipe(), asked) == ("td3",)
