import pytest

from maglev_offline import pipeline
from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.ingest.store import LogOutcome
from maglev_offline.pipeline import Done, Ingested
from maglev_offline.progress import SILENT
from maglev_offline.recipe import Recipe
from maglev_offline.workspace import Workspace


def outcome(tmp_path, status):
    return LogOutcome(tmp_path / f"{status}.mcap", f"{status}-id", status, {"rows": 1200}, {}, "message", None)


def test_the_algorithms_are_those_asked_for_or_those_of_the_recipe():
    recipe = Recipe(training=TrainingSettings(algorithms=("td3",)))
    assert pipeline.algorithms(recipe, None) == ("td3",)
    assert pipeline.algorithms(recipe, "ddpg") == ("ddpg",)


def test_an_algorithm_that_is_not_known_or_none_at_all_is_refused():
    with pytest.raises(InputError, match="no algorithm 'sac'"):
        pipeline.algorithms(Recipe(), "sac")
    with pytest.raises(InputError, match="trains no algorithm"):
        pipeline.algorithms(Recipe(training=TrainingSettings(algorithms=())), None)


def test_a_stage_says_whether_it_did_anything(tmp_path):
    done, unchanged = (Done("curate", tmp_path, fresh, "9 transitions", {"rows": 9}) for fresh in (True, False))
    assert done.plain() == {"stage": "curate", "status": "done", "artefact": str(tmp_path), "rows": 9}
    assert unchanged.plain()["status"] == "unchanged"
    assert done.lines() == ["curate: 9 transitions", f"  -> {tmp_path}"]
    assert "nothing was done" in unchanged.lines()[0]


def test_ingestion_is_refused_where_one_log_is(tmp_path):
    good, bad = outcome(tmp_path, "ingested"), outcome(tmp_path, "refused")
    assert Ingested([good], None).plain()["status"] == "done"
    mixed = Ingested([good, bad], None)
    assert mixed.refused == [bad]
    assert mixed.plain()["status"] == "refused"
    assert mixed.rows()[0] == ["ingested.mcap", "ingested", "-", "-", "-", "1,200", "-"]
    assert all(len(row) == len(pipeline.LOG_COLUMNS) for row in mixed.rows())


def test_an_arm_that_is_not_known_is_refused(tmp_path):
    with pytest.raises(InputError, match="no arm 'full'"):
        pipeline.train(Recipe(), Workspace(tmp_path), None, "full", 1, SILENT)


def test_the_road_needs_a_log_that_can_be_used(tmp_path):
    (tmp_path / "bad.mcap").write_text("no MCAP")
    with pytest.raises(ArtefactError, match="none of the logs could be used"):
        pipeline.run(Recipe(), Workspace(tmp_path / "w"), [tmp_path / "bad.mcap"], 1, SILENT)
