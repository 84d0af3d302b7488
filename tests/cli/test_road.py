import pytest

from maglev_offline.workspace import Workspace


def test_the_whole_road_ends_in_a_report_and_is_not_gone_twice(here, call):
    first = call("run", "tiny.toml", "--jobs", 1, "--json")
    assert first.code == 0
    stages = [(one["stage"], one["status"]) for one in first.json["stages"]]
    assert stages == [(name, "done") for name in ("curate", "control", "prefill", "transfer", "report")]
    page = (here / first.json["report"]).read_text()
    assert page.lstrip().lower().startswith("<!doctype html>")
    again = call("run", "tiny.toml", "--jobs", 1, "--json")
    assert {one["status"] for one in again.json["stages"]} == {"unchanged"}
    assert not list((here / "workspace").rglob(".*.draft"))


def test_a_refused_log_does_not_stop_the_road_but_its_exit_code_tells(here, call):
    recipe = here / "tiny.toml"
    recipe.write_text(recipe.read_text().replace('["ddpg"]', "[]"))
    (here / "logs/bad.mcap").write_text("no MCAP")
    called = call("run", "tiny.toml", "--json")
    assert called.code == 2
    assert called.json["status"] == "refused"
    assert [one["stage"] for one in called.json["stages"]] == ["curate", "control", "report"]
    assert (here / called.json["report"]).is_file()


def test_logs_on_the_command_line_take_the_place_of_the_recipes_own(here, call):
    recipe = here / "tiny.toml"
    recipe.write_text(recipe.read_text().replace('["ddpg"]', "[]"))
    called = call("run", "tiny.toml", "logs/surrogate-01-pid-json.mcap", "--json")
    assert called.code == 0
    assert len(called.json["ingest"]["logs"]) == 1
    assert len(Workspace(here / "workspace").list("samples")) == 1


def test_the_road_ends_where_no_log_can_be_used(here, call):
    (here / "bad.mcap").write_text("no MCAP")
    called = call("run", "tiny.toml", "bad.mcap", "--json")
    assert called.code == 2
    assert called.json["what"] == "none of the logs could be used."
    assert not (here / "workspace/control").exists()


@pytest.mark.usefixtures("here")
def test_a_report_of_an_empty_workspace_says_what_is_missing(call):
    called = call("report", "--json")
    assert called.code == 0
    assert called.json["status"] == "done"
