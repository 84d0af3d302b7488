"""The commands on trained policies, on a training of a second."""

import json
import re
import sys

import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from maglev_offline.cli import app
from maglev_offline.policies.tensors import load_policy

TRAIN = ("train", "--recipe", "tiny.toml", "--jobs", 1)


@pytest.fixture
def trained(here, call):
    """A workspace with two seeds of ddpg-empty."""
    assert call(*TRAIN).code == 0
    return here


@pytest.mark.parametrize("command", ["export", "rollout"])
def test_each_command_has_an_example_that_it_understands_and_the_shared_options(command):
    runner = CliRunner(env={"COLUMNS": "200", "TERM": "dumb", "NO_COLOR": "1"})
    text = re.sub(r"\x1b\[[0-9;]*m", "", runner.invoke(app, ["policy", command, "--help"]).output)
    example = re.search(rf"Example: maglev-offline policy {command} (.+)", text).group(1)
    assert all(word in text for word in example.split() if word.startswith("--"))
    assert all(option in text for option in ("--json", "--workspace", "--recipe", "--quiet"))
    assert " policy " in runner.invoke(app, ["--help"]).output


def test_export_writes_each_format_with_where_it_comes_from(trained, call):
    pytest.importorskip("onnx", reason="onnx is not installed (pip install '.[export]')")
    for form, ending in (("safetensors", "safetensors"), ("c", "h"), ("onnx", "onnx")):
        called = call("policy", "export", "--format", form, "--which", "last", "--seed", 1, "--json")
        assert called.code == 0
        assert called.json["file"] == f"ddpg-empty-seed-0001-last.{ending}"
        written = (trained / called.json["file"]).read_bytes()
        assert called.json["policy"]["manifest_sha256"].encode() in written
    policy = load_policy(trained / "ddpg-empty-seed-0001-last.safetensors")
    assert (policy.origin.seed, policy.origin.which, policy.mdp.episode_duration_s) == (1, "last", 0.1)


def test_export_goes_where_it_is_told(trained, call):
    called = call("policy", "export", "--format", "c", "--seed", 0, "--out", "firmware/policy.h")
    assert called.code == 0
    assert "firmware/policy.h: ddpg, arm empty, seed 0, best" in called.out
    assert "maglev_policy_voltage" in (trained / "firmware/policy.h").read_text()


@pytest.mark.usefixtures("here")
def test_without_a_training_it_says_what_to_run(call):
    called = call("policy", "export", "--format", "c", "--seed", 0)
    assert called.code == 2
    assert "no agent has been trained in this workspace" in called.err
    assert "maglev-offline train" in called.err


@pytest.mark.usefixtures("trained")
@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("--format", "c", "--seed", 9), "seeds 0 to 1"),
        (("--format", "c", "--seed", 0, "--algo", "td3"), "--algo td3 was not trained"),
        (("--format", "c", "--seed", 0, "--out", "workspace"), "this is a folder"),
        (("--format", "matlab", "--seed", 0), "matlab"),
        (("--format", "c"), "--seed"),
    ],
)
def test_what_cannot_be_exported_is_told(call, options, what):
    called = call("policy", "export", *options)
    assert called.code == 2
    assert what in called.err


def test_onnx_without_its_package_says_what_to_install(trained, call, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    called = call("policy", "export", "--format", "onnx", "--seed", 0)
    assert called.code == 2
    assert "pip install 'maglev-offline[export]'" in called.err
    assert not list(trained.glob("*.onnx"))


def test_a_damaged_training_is_refused(trained, call):
    (path,) = trained.glob("workspace/training/*/*/best.safetensors")
    path.write_bytes(path.read_bytes()[:-1])
    called = call("policy", "export", "--format", "c", "--seed", 0)
    assert called.code == 2
    assert "best.safetensors is not what was written" in called.err


def test_a_rollout_lies_beside_the_logs_and_is_ingested(trained, call):
    controllers = ("--controller", "policy", "--controller", "lqr", "--start-gap-mm", 12, "--duration-s", 1)
    called = call("policy", "rollout", "--out", "run.mcap", "--seed", 0, *controllers, "--at", "2025-03-01T12:00:00")
    assert called.code == 0
    assert all(word in called.out for word in ("settling time", "lqr", "simulated"))
    with (trained / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary.statistics.message_start_time == 1_740_830_400 * 10**9
    assert {channel.topic for channel in summary.channels.values()} == {
        "/suspension/policy/state",
        "/suspension/lqr/state",
    }
    ingested = call("ingest", "run.mcap", "--json").json
    assert ingested["logs"][0]["status"] == "ingested"
    assert ingested["logs"][0]["counts"]["messages"] == 2000


def test_a_rollout_takes_an_exported_policy_and_tells_when_the_world_is_another(trained, call):
    call("policy", "export", "--format", "safetensors", "--seed", 0, "--out", "mine.safetensors")
    (trained / "plant.toml").write_text("[plant]\nmass_kg = 650\n")
    asked = ("policy", "rollout", "--out", "run.mcap", "--policy", "mine.safetensors", "--json")
    assert "another world" not in call(*asked).err
    called = call(*asked, "--plant", "plant.toml")
    assert called.code == 0
    assert "mass_kg = 650.0 (trained: 700.0)" in called.err
    assert called.json["responses"][0]["controller"] == "policy"


@pytest.mark.usefixtures("here")
def test_a_classical_controller_needs_no_training(call):
    called = call("policy", "rollout", "--out", "run.mcap", "--controller", "lqi", "--json")
    assert called.code == 0
    assert called.json["topics"] == ["/suspension/lqi/state"]
    assert json.dumps(called.json["responses"][0]["cost"])


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("options", "what"),
    [
        (("--controller", "mpc"), "there is no controller 'mpc'"),
        ((), "Give --seed, or --policy FILE"),
        (("--policy", "nowhere.safetensors"), "no such policy file"),
        (("--controller", "lqr", "--start-gap-mm", 30), "not between the stops"),
        (("--controller", "lqr", "--at", "noon"), "noon"),
    ],
)
def test_what_cannot_be_rolled_out_is_told(call, options, what):
    called = call("policy", "rollout", "--out", "run.mcap", *options)
    assert called.code == 2
    assert what in called.err
