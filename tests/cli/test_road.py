from pathlib import Path

import pytest

from maglev_offline.report.evidence import gather
from maglev_offline.workspace import Manifest, Workspace


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


@pytest.mark.usefixtures("undrawn")
def test_a_refused_log_does_not_stop_the_road_but_its_exit_code_tells(here, call):
    recipe = here / "tiny.toml"
    recipe.write_text(recipe.read_text().replace('["ddpg"]', "[]"))
    (here / "logs/bad.mcap").write_text("no MCAP")
    called = call("run", "tiny.toml", "--json")
    assert called.code == 2
    assert called.json["status"] == "refused"
    assert [one["stage"] for one in called.json["stages"]] == ["curate", "control", "report"]
    assert (here / called.json["report"]).is_file()


@pytest.mark.usefixtures("undrawn")
def test_logs_on_the_command_line_take_the_place_of_the_recipes_own(here, call):
    recipe = here / "tiny.toml"
    recipe.write_text(recipe.read_text().replace('["ddpg"]', "[]"))
    called = call("run", "tiny.toml", "logs/surrogate-01-pid-json.mcap", "--json")
    assert called.code == 0
    assert len(called.json["ingest"]["logs"]) == 1
    assert len(Workspace(here / "workspace").list("samples")) == 1


@pytest.mark.usefixtures("undrawn")
def test_the_road_ends_where_no_log_can_be_used(here, call):
    (here / "bad.mcap").write_text("no MCAP")
    called = call("run", "tiny.toml", "bad.mcap", "none.mcap", "--json")
    assert called.code == 2
    assert called.json["status"] == "refused"
    assert {log["file"]: log["status"] for log in called.json["ingest"]["logs"]} == {
        "bad.mcap": "refused",
        "none.mcap": "refused",
    }
    assert (called.json["stages"], called.json["report"]) == ([], None)
    assert sum("none.mcap" in line for line in called.err.splitlines()) == 1
    assert not (here / "workspace/control").exists()
    assert "None of the logs could be used" in call("run", "tiny.toml", "bad.mcap").out


@pytest.mark.usefixtures("undrawn")
def test_the_road_is_about_the_logs_that_it_was_given_whatever_else_is_in_the_workspace(here, call):
    recipe = here / "tiny.toml"
    recipe.write_text(recipe.read_text().replace('["ddpg"]', "[]"))
    assert call("run", "tiny.toml").code == 0
    called = call("run", "tiny.toml", "logs/surrogate-01-pid-json.mcap", "--json")
    workspace = Workspace(here / "workspace")
    assert len(workspace.list("samples")) == 3
    (name,) = Manifest.read(workspace.path("transitions")).inputs
    assert name.startswith("samples/surrogate-01-pid-json-")
    page = (here / called.json["report"]).read_text()
    told = page.split("In the workspace, but not in the transitions that this page is about:")[1].split("</p>")[0]
    assert "surrogate-02-cascade-cdr" in told
    assert "surrogate-03-pid-protobuf" in told
    assert "surrogate-01-pid-json" not in told


def test_a_card_lies_in_the_workspace_and_where_it_is_wanted(here, call):
    assert call("card").code == 2  # there are no transitions yet
    assert call("ingest", "logs/surrogate-01-pid-json.mcap", "--recipe", "tiny.toml").code == 0
    made = call("card", "--out", "for/you", "--json")
    assert (made.code, made.json["status"], made.json["simulated"]) == (0, "done", "all")
    for name in ("card.json", "card.html"):
        assert str(Path("for/you", name)) in made.json["files"]
        assert (here / "for/you" / name).read_bytes() == (here / "workspace/card" / name).read_bytes()
    (here / "other.toml").write_text((here / "tiny.toml").read_text().replace("target_rows = 200", "target_rows = 100"))
    again = call("card", "--recipe", "other.toml")
    assert "nothing was done" in again.out
    assert "made with other tables than the recipe has ([curate])" in again.err
    refused = call("card", "--out", "tiny.toml")
    assert refused.code == 2
    assert "Give a folder to --out" in refused.err


@pytest.fixture
def wide(here):
    """A recipe whose blocks hold four seeds, so that studies of two and of three overlap."""
    (here / "wide.toml").write_text((here / "tiny.toml").read_text().replace("block = 2", "block = 4"))


@pytest.mark.usefixtures("here")
def test_a_report_of_an_empty_workspace_is_refused_and_says_what_to_run(call):
    called = call("report", "--json")
    assert called.code == 2
    assert called.json["what"] == "there is nothing in the workspace to report on."
    assert "maglev-offline ingest LOGS" in called.json["todo"]


@pytest.mark.usefixtures("wide", "undrawn")
def test_a_report_without_a_comparison_counts_each_seed_once(here, call):
    for seeds in (2, 3):
        assert call("train", "--seeds", seeds, "--recipe", "wide.toml", "--jobs", 1).code == 0
    blocks = [path.name for path in (here / "workspace/training/ddpg-empty").iterdir()]
    assert sorted(blocks) == ["seeds-0000-0001", "seeds-0000-0002"]
    evidence = gather(Workspace(here / "workspace"))
    assert [block.folder.name for block in evidence.blocks] == ["seeds-0000-0002"]
    assert not evidence.curves().duplicated(["algorithm", "arm", "seed", "env_step"]).any()
    called = call("report", "--recipe", "wide.toml", "--json")
    assert called.code == 0
    page = (here / "workspace/report/report.html").read_text()
    assert "3 seeds" in page


def test_blocks_that_follow_each_other_are_all_counted(here, call):
    for seeds in (2, 4):
        assert call("train", "--seeds", seeds, "--recipe", "tiny.toml", "--jobs", 1).code == 0
    curves = gather(Workspace(here / "workspace")).curves()
    assert sorted(curves["seed"].unique()) == [0, 1, 2, 3]


@pytest.mark.usefixtures("wide")
def test_blocks_that_were_trained_otherwise_are_not_mixed(here, call):
    for options in (("--seeds", 2, "--steps", 150), ("--seeds", 4, "--steps", 200)):
        assert call("train", *options, "--recipe", "wide.toml", "--jobs", 1).code == 0
    curves = gather(Workspace(here / "workspace")).curves()
    assert curves.groupby("seed")["env_step"].max().unique().tolist() == [200]
