import pandas as pd
import pytest

from maglev_offline.workspace import Manifest

TINY = ("--recipe", "tiny.toml", "--jobs", 1)


def test_control_tries_every_controller_once(here, call):
    first, again = (call("control", "--recipe", "tiny.toml", "--json") for _ in range(2))
    assert (first.code, first.json["status"], again.json["status"]) == (0, "done", "unchanged")
    assert len(pd.read_parquet(here / "workspace/control/metrics.parquet")) > 0
    shown = call("control", "--recipe", "tiny.toml").out
    assert all(name in shown for name in ("pid", "cascade", "lqr", "lqi"))


def test_train_takes_its_seeds_and_steps_from_the_command_line(here, call):
    called = call("train", "--algo", "td3", "--seeds", 3, "--steps", 120, *TINY, "--json")
    assert called.code == 0
    assert list(called.json["arms"]) == ["td3-empty"]
    curves = pd.concat(pd.read_parquet(here / folder / "curves.parquet") for folder in called.json["arms"]["td3-empty"])
    assert sorted(curves["seed"].unique()) == [0, 1, 2]
    assert curves["env_step"].max() == 120


def test_train_with_a_prefill_makes_it_first(here, call):
    call("ingest", "logs", "--recipe", "tiny.toml")
    called = call("train", "--arm", "prefill", "--seeds", 1, "--jobs", 1)
    assert called.code == 0
    assert "ddpg-prefill" in called.out
    assert (here / "workspace/prefill/ddpg/prefill.safetensors").is_file()


@pytest.mark.usefixtures("here")
def test_transfer_shows_every_metric_of_every_algorithm_with_its_verdict(call):
    call("ingest", "logs", "--recipe", "tiny.toml")
    called = call("transfer", *TINY)
    assert called.code == 0
    for metric in ("jumpstart", "asymptote", "area", "time to threshold"):
        assert f"ddpg: {metric}" in called.out
    assert "95% interval" in called.out
    data = call("transfer", *TINY, "--json").json
    assert data["status"] == "unchanged"
    assert data["verdict"]["algorithms"]["ddpg"]["effects"]["prefill"]["area"]["seeds"] == 2


def test_the_interval_is_named_by_its_confidence(here, call):
    recipe = here / "tiny.toml"
    recipe.write_text(recipe.read_text().replace("resamples = 200", "resamples = 200\nconfidence = 0.9"))
    call("ingest", "logs", "--recipe", "tiny.toml")
    assert "90% interval" in call("transfer", *TINY).out
    assert Manifest.read(here / "workspace/transfer").settings["transfer"]["confidence"] == 0.9
