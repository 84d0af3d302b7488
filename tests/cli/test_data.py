import re

import numpy as np
import pandas as pd
import pytest

from maglev_offline.replay.prefill import load_prefill
from maglev_offline.workspace import Manifest, Workspace

STEMS = ["surrogate-01-pid-json", "surrogate-02-cascade-cdr", "surrogate-03-pid-protobuf"]


def drafts(folder):
    return [path for path in folder.rglob(".*") if path.name not in (".lock", ".known_hashes.json")]


def hashes(workspace):
    return {path.relative_to(workspace): path.read_bytes() for path in workspace.rglob("manifest.json")}


def test_two_commands_lead_from_logs_to_a_prefill(here, call):
    ingested = call("ingest", "logs/*.mcap")
    assert (ingested.code, call("prefill", "--algo", "ddpg").code) == (0, 0)
    workspace = Workspace(here / "workspace")
    assert [path.name[:-9] for path in workspace.list("samples")] == STEMS
    transitions = Manifest.read(workspace.path("transitions"))
    samples = sum(Manifest.read(path).counts["rows"] for path in workspace.list("samples"))
    segments = sum(Manifest.read(path).counts["segments"] for path in workspace.list("samples"))
    assert transitions.counts["pairs"] == samples - segments
    rows = load_prefill(workspace.path("prefill", "ddpg"))
    assert len(rows["cost"]) == transitions.counts["transitions"] > 1000
    assert abs(rows["action"]).max() <= 1
    table = pd.read_parquet(workspace.path("transitions", "transitions.parquet"))
    assert rows["observation"][:, 0] == pytest.approx(table["gap_error_m"] / 0.0025, rel=1e-6)
    assert drafts(here / "workspace") == []
    assert all(stem in ingested.out for stem in STEMS)
    assert str(workspace.path("transitions").relative_to(here)) in ingested.out


def test_the_same_commands_again_do_nothing(here, call):
    for _ in range(2):
        first, second = call("ingest", "logs", "--json"), call("prefill", "--json")
        before = hashes(here / "workspace")
    assert {log["status"] for log in first.json["logs"]} == {"skipped"}
    assert first.json["transitions"]["status"] == "unchanged"
    assert [one["status"] for one in second.json["prefills"]] == ["unchanged", "unchanged"]
    assert hashes(here / "workspace") == before


def test_two_processes_and_another_workspace_give_the_same_bytes(here, call):
    assert call("ingest", "logs", "--jobs", 1).code == 0
    assert call("ingest", here / "logs", "--jobs", 2, "--workspace", here / "other").code == 0
    assert hashes(here / "workspace") == hashes(here / "other")


def test_the_workspace_may_come_from_the_environment(here, call, monkeypatch):
    monkeypatch.setenv("MAGLEV_OFFLINE_WORKSPACE", str(here / "elsewhere"))
    assert call("ingest", "logs").code == 0
    assert (here / "elsewhere/transitions/manifest.json").is_file()
    assert not (here / "workspace").exists()


def test_a_recipe_is_remembered_for_the_commands_that_follow(here, call):
    assert call("ingest", "logs", "--recipe", "tiny.toml").code == 0
    later = call("curate", "--json")
    assert later.json["counts"]["transitions"] == 200
    assert later.json["status"] == "unchanged"
    assert "recipe: tiny" in later.err


def test_curating_with_another_recipe_makes_the_transitions_anew(here, call):
    call("ingest", "logs")
    again = call("curate", "--recipe", "tiny.toml", "--json")
    assert (again.code, again.json["status"], again.json["counts"]["transitions"]) == (0, "done", 200)


@pytest.mark.parametrize("command", [("curate",), ("prefill",), ("control",)])
@pytest.mark.usefixtures("undrawn")
def test_any_command_that_works_in_a_workspace_lets_it_remember_its_recipe(here, call, command):
    call("ingest", "logs")
    (here / "named.toml").write_text(
        'name = "named"\n[control]\nduration_s = 0.5\nrobustness_cells = 2\nrobustness_duration_s = 0.1\n'
    )
    assert call(*command, "--recipe", "named.toml").code == 0
    assert "recipe: named" in call("report").err


def test_samples_that_another_recipe_made_are_left_out_and_named(here, call):
    call("ingest", "logs")
    (here / "finer.toml").write_text("[ingest]\ngrid_ms = 50\n")
    refused = call("curate", "--recipe", "finer.toml")
    assert refused.code == 2
    assert "samples of 3 of 3 logs were made with other [signals], [ingest] or [plant]" in refused.err
    first = sorted((here / "logs").glob("*.mcap"))[0]
    mixed = call("ingest", first, "--recipe", "finer.toml", "--json")
    assert mixed.code == 0
    assert "samples of 2 of 3 logs" in mixed.err
    assert mixed.json["transitions"]["coverage"]["occupancy_before"]["rows"] > 0


def test_looking_at_a_log_shows_its_channels_and_signals_and_writes_nothing(here, call):
    shown = call("inspect", "logs/*.mcap")
    assert shown.code == 0
    assert "/suspension/P1/state" in shown.out
    assert "gap = gap_mm (mm)" in shown.out
    assert "SIMULATED" in shown.out
    assert sorted(path.name for path in here.iterdir()) == ["logs", "tiny.toml"]
    data = call("inspect", "logs", "--json").json
    assert [log["simulated"] for log in data["logs"]] == [True] * 3


def test_surrogate_logs_depend_on_their_seed_alone(here, call):
    options = ("--logs", 1, "--points", 1, "--duration-s", 5, "--json")
    one, same = (call("surrogate", name, *options).json["logs"][0] for name in ("one", "same"))
    other = call("surrogate", "other", *options, "--seed", 7).json["logs"][0]
    assert (here / one).read_bytes() == (here / same).read_bytes() != (here / other).read_bytes()


@pytest.fixture
def bad_files(here, mcap_files):
    """One file of each kind that cannot be used, by name."""
    whole = (here / f"logs/{STEMS[0]}.mcap").read_bytes()
    bad = here / "bad"
    bad.mkdir()
    (bad / "text.mcap").write_text("this is no MCAP")
    (bad / "empty.mcap").touch()
    (bad / "cut.mcap").write_bytes(whole[:60])
    mcap_files.write(
        bad / "unmapped.mcap",
        [mcap_files.Msg("/camera/exposure", 1_700_000_000_000_000_000 + k * 10**8, {"shutter": 1.0}) for k in range(9)],
    )
    return bad


@pytest.mark.parametrize("name", ["text", "empty", "cut", "unmapped"])
def test_a_bad_log_is_refused_in_one_paragraph_and_the_others_are_ingested(here, call, bad_files, name):
    called = call("ingest", "logs", f"bad/{name}.mcap", "--json")
    assert called.code == 2
    lines = [line for line in called.err.splitlines() if f"{name}.mcap" in line]
    assert len(lines) == 1
    assert "Traceback" not in called.err
    assert called.json["status"] == "refused"
    status = {re.sub(r".*/", "", log["file"]): log["status"] for log in called.json["logs"]}
    assert status == {f"{name}.mcap": "refused", **{f"{stem}.mcap": "ingested" for stem in STEMS}}
    assert len(Workspace(here / "workspace").list("samples")) == 3
    assert called.json["transitions"]["status"] == "done"
    assert drafts(here / "workspace") == []


@pytest.mark.parametrize("name", ["text", "empty", "cut", "unmapped"])
def test_a_bad_log_alone_leaves_nothing_behind(here, call, bad_files, name):
    called = call("ingest", f"bad/{name}.mcap", "--json")
    assert called.code == 2
    assert called.json["transitions"] is None
    assert called.json["logs"][0]["message"]
    assert "Traceback" not in called.err
    assert Workspace(here / "workspace").list("samples") == []
    assert drafts(here / "workspace") == []


def test_bad_logs_are_refused_by_a_look_too(call, bad_files):
    called = call("inspect", bad_files / "text.mcap", "--json")
    assert (called.code, called.json["status"], called.json["logs"]) == (2, "refused", [])
    assert "text.mcap" in called.json["refused"][0]["where"]


def test_a_path_that_is_not_there_is_refused_alone(here, call):
    called = call("ingest", "none.mcap", "logs", "--json")
    assert called.code == 2
    status = [log["status"] for log in called.json["logs"]]
    assert sorted(status) == ["ingested", "ingested", "ingested", "refused"]
    assert called.json["transitions"]["status"] == "done"
    (told,) = [line for line in called.err.splitlines() if "none.mcap" in line]
    assert told.startswith("error: ")
    assert len(Workspace(here / "workspace").list("samples")) == 3


def test_nothing_is_curated_where_no_log_can_be_used(here, call):
    (here / "bad.mcap").write_text("no MCAP")
    call("ingest", "logs")
    before = hashes(here / "workspace")
    called = call("ingest", "bad.mcap", "--recipe", "tiny.toml", "--json")
    assert called.code == 2
    assert called.json["transitions"] is None
    assert hashes(here / "workspace") == before


@pytest.mark.parametrize("kind", ["samples", "transitions"])
@pytest.mark.parametrize("damage", ["cut", "gone", "other"])
def test_ingest_makes_a_tampered_artefact_anew(here, call, kind, damage):
    call("ingest", "logs")
    before = hashes(here / "workspace")
    path = sorted((here / "workspace").rglob(f"{kind}.parquet"))[0]
    whole = path.read_bytes()
    if damage == "gone":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(whole[:100])
    else:
        pd.read_parquet(path).head(20).to_parquet(path)
    assert call("ingest", "logs").code == 0
    assert path.read_bytes() == whole
    assert hashes(here / "workspace") == before


def test_curate_makes_tampered_transitions_anew_and_prefill_refuses_them(here, call):
    call("ingest", "logs")
    path = here / "workspace/transitions/transitions.parquet"
    whole = path.read_bytes()
    pd.read_parquet(path).head(20).to_parquet(path)
    refused = call("prefill", "--algo", "ddpg")
    assert refused.code == 2
    assert "transitions.parquet is not what was written there. Remove that folder and run its stage" in refused.err
    assert not (here / "workspace/prefill").exists()
    assert call("curate", "--json").json["status"] == "done"
    assert path.read_bytes() == whole
    assert call("prefill", "--algo", "ddpg").code == 0


def test_curate_refuses_tampered_samples(here, call):
    call("ingest", "logs")
    path = sorted((here / "workspace").rglob("samples.parquet"))[0]
    pd.read_parquet(path).head(20).to_parquet(path)
    refused = call("curate")
    assert refused.code == 2
    assert "samples.parquet is not what was written there" in refused.err


def test_the_recipe_of_a_command_that_failed_is_not_remembered(here, call):
    call("ingest", "logs", "--recipe", "tiny.toml")
    (here / "finer.toml").write_text('name = "finer"\n[ingest]\ngrid_ms = 50\n')
    assert call("curate", "--recipe", "finer.toml").code == 2
    later = call("curate", "--json")
    assert "recipe: tiny" in later.err
    assert later.json["status"] == "unchanged"


@pytest.mark.usefixtures("undrawn")
def test_logs_that_do_not_fit_the_plant_are_doubted_in_a_warning_and_on_the_page(here, call):
    (here / "heavy.toml").write_text("[plant]\nmass_kg = 70_000\n")
    warned = call("ingest", "logs", "--recipe", "heavy.toml").err
    assert "carries 70000 kg" in warned
    assert call("report").code == 0
    page = (here / "workspace/report/report.html").read_text()
    assert "To be doubted: the logged current (median " in page
    assert "carries 70000 kg" in page


def test_curate_says_whether_the_rows_teach_the_truth_and_so_does_prefill(here, call):
    call("ingest", "logs")
    shown, data = call("curate"), call("curate", "--json").json
    found = data["diagnostic"]
    assert data["construction"] == "raw"
    assert found["verdict"] != "fit"
    assert found["error_over_advantage_std"] > 1
    for name in ("correlation_with_advantage", "error_over_advantage_std"):
        low, high = found[f"{name}_interval"]
        assert low < high
    residual = data["residual"]
    assert residual["duration_s"] == 0.1
    assert f"explains {residual['logs']['explained']} of {residual['logs']['judged']} logs" in shown.out
    prefilled = call("prefill", "--algo", "td3")
    for text in (shown.out, prefilled.out):
        assert f"raw rows are {found['verdict']}" in text.replace("\n", " ")
    assert call("prefill", "--json").json["prefills"][0]["diagnostic"] == found


def test_a_prefill_leaves_for_another_library_and_a_small_buffer_is_refused(here, call):
    call("ingest", "logs", "--recipe", "tiny.toml")
    for status in ("done", "unchanged"):
        data = call("prefill", "--format", "npz", "--capacity", 201, "--json").json
        assert [(one["algorithm"], one["rows"], one["status"]) for one in data["exports"]] == [("ddpg", 200, status)]
    with np.load(here / data["exports"][0]["artefact"] / "prefill.npz") as arrays:
        np.testing.assert_array_equal(arrays["rewards"], -load_prefill(here / "workspace/prefill/ddpg")["cost"])
    shown = call("prefill", "--format", "sb3")
    assert "maglev_offline.replay.exports.sb3.fill_model(model, " in shown.out.replace("\n", "")
    refused = call("prefill", "--capacity", 200)
    assert refused.code == 2
    assert "200 prefilled rows do not fit into 200 slots" in refused.err
    assert call("prefill", "--format", "pickle").code == 2


def test_a_construction_may_be_named_on_the_command_line(here, call):
    call("ingest", "logs")
    made = call("curate", "--construction", "semi_markov", "--json").json
    assert (made["construction"], made["status"]) == ("semi_markov", "done")
    assert call("prefill", "--algo", "ddpg").code == 0
    table = pd.read_parquet(here / "workspace/transitions/transitions.parquet")
    rows = load_prefill(here / "workspace/prefill/ddpg")
    assert set(table["origin"]) == {"semi_markov"}
    assert rows["discount"] == pytest.approx(0.9 ** (table["duration_s"].to_numpy() / 0.01), rel=1e-6)
    assert call("prefill", "--algo", "ddpg", "--format", "torchrl").code == 0
    refused = call("prefill", "--algo", "ddpg", "--format", "sb3")
    assert refused.code == 2
    assert "rows of the construction semi_markov carry a discount of their own" in " ".join(refused.err.split())
    refused = call("curate", "--construction", "cooked")
    assert refused.code == 2
    assert "'reconstructed' or 'simulated_next' (given: 'cooked')" in refused.err
    assert "Traceback" not in refused.err


def test_a_balance_may_be_named_on_the_command_line(here, call):
    call("ingest", "logs")
    made = call("curate", "--balance", "quantiles", "--json").json
    assert (made["coverage"]["balance"], made["status"]) == ("quantiles", "done")
    assert "balance quantiles" in call("curate", "--balance", "quantiles").out
    refused = call("curate", "--balance", "fair")
    assert refused.code == 2
    assert "'low_cost' or 'none' (given: 'fair')" in refused.err


def test_a_verdict_fails_a_script_that_asks_for_it(here, call):
    call("ingest", "logs")
    bad = {"doubtful": {"never": 0, "doubtful": 1, "harmful": 0}, "harmful": {"never": 0, "doubtful": 2, "harmful": 2}}
    for name in ("raw", "semi_markov"):
        verdict = call("curate", "--construction", name, "--json").json["diagnostic"]["verdict"]
        codes = {on: call("curate", "--construction", name, "--fail-on", on).code for on in bad["harmful"]}
        assert codes == bad[verdict]
    fit = call("curate", "--construction", "simulated_next", "--fail-on", "doubtful", "--json")
    assert (fit.code, fit.json["diagnostic"]["verdict"]) == (0, "fit")
    assert call("curate", "--fail-on", "always").code == 2
