import pandas as pd
import pytest

from maglev_offline.agents import engine, events
from maglev_offline.workspace import Manifest

TINY = ("--recipe", "tiny.toml", "--jobs", 1)


@pytest.mark.usefixtures("undrawn")
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
def test_train_ends_with_last_and_best_policies_beside_lqr_lqi_and_pid(call):
    called = call("train", "--engine", "torch", *TINY)
    assert called.code == 0
    rows = [line.split("  ")[0] for line in called.out.splitlines()]
    assert rows[2:8] == ["ddpg-empty, last", "ddpg-empty, best", "LQR every 10 ms", "LQR", "LQI", "PID"]
    for column in ("return", "settles (s)", "overshoot", "bias (mm)", "within 0.5 mm"):
        assert column in called.out
    assert "Engine: torch, because it was asked for" in called.err
    assert "2 runs of 200 steps on the torch engine" in called.out


@pytest.mark.usefixtures("here")
def test_train_gives_scripts_its_engine_and_every_standing(call):
    data = call("train", "--engine", "torch", *TINY, "--json").json
    assert data["engine"]["engine"] == "torch"
    assert data["engine"]["engine_why"] == "it was asked for"
    assert set(data["engine"]) == {"engine", "engine_why", "instruction_set", "compiler"}
    assert data["diverged"] == 0
    standings = {one["policy"]: one for one in data["standings"]}
    assert standings["ddpg-empty, last"]["seeds"] == 2
    assert standings["LQI"]["seeds"] == 0
    for one in standings.values():
        assert set(one["return"]) == {"median", "least", "greatest"}
        assert one["return"]["least"] <= one["return"]["median"] <= one["return"]["greatest"] < 0


def test_an_engine_that_cannot_run_is_not_replaced_in_silence(here, call, monkeypatch):
    monkeypatch.setattr(engine, "native_availability", lambda: (False, "the kernel is not built"))
    asked = call("train", "--engine", "native", *TINY)
    assert asked.code == 2
    assert (
        "--engine native: the native engine cannot run here: the kernel is not built. Take --engine torch" in asked.err
    )
    assert not (here / "workspace/training").exists()
    taken = call("train", *TINY)
    assert taken.code == 0
    assert "Engine: torch, because the native one cannot run here: the kernel is not built." in taken.err


@pytest.mark.usefixtures("here")
def test_an_engine_that_there_is_not_is_refused(call):
    called = call("train", "--engine", "jax", *TINY)
    assert called.code == 2
    assert "[training] engine: input should be 'auto', 'torch' or 'native' (given: 'jax')" in called.err


def test_tensorboard_without_its_package_ends_before_any_training(here, call, monkeypatch):
    monkeypatch.setattr(events, "find_spec", lambda name: None)
    called = call("train", "--tensorboard", *TINY)
    assert called.code == 2
    assert "--tensorboard: TensorBoard is not installed. Run `pip install" in called.err
    assert not (here / "workspace/training").exists()


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
