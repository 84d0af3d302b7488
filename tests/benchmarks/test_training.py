"""The benchmark of training: everyone does the work that is compared, and what is missed is named."""

import json
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest
import torch
import training
import training_loop
import training_peers as peers

import maglev_offline.env  # noqa: F401
from maglev_offline.agents.native_library import isas
from maglev_offline.agents.settings import TrainingSettings

pytestmark = pytest.mark.nightly

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(autouse=True)
def one_thread():
    """As the benchmark has it: on a busy machine threads wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def row(contender, rate=None, algorithm="td3", name=None, **more):
    times = {"steps_per_s": rate} if rate else {}
    return {"algorithm": algorithm, "contender": contender, "name": name or contender, "failure": "", **times} | more


@pytest.mark.parametrize("algorithm", training.ALGORITHMS)
def test_the_loop_makes_a_gradient_step_for_each_step_of_the_environment(algorithm):
    env = gymnasium.make("maglev_offline/Suspension-v0")
    loop = training_loop.Loop(env, twin=algorithm == "td3")
    before = [parameter.detach().clone() for parameter in (*loop.actor.parameters(), *loop.slow_critics.parameters())]
    loop.run(training_loop.BATCH + 20)
    assert loop.updates == 20
    after = [*loop.actor.parameters(), *loop.slow_critics.parameters()]
    assert all(not torch.equal(old, new) for old, new in zip(before, after, strict=True))
    assert len(loop.critics) == (2 if algorithm == "td3" else 1)


def test_the_loop_learns_values_and_goes_where_they_are_high():
    """Every action ends at once, and is worth itself."""
    loop = training_loop.Loop(gymnasium.make("maglev_offline/Suspension-v0"), twin=False)
    action = torch.linspace(-1, 1, 100)[:, None]
    seen, ended = torch.zeros(100, 3), torch.ones(100, 1)
    for _ in range(400):
        loop.update({"seen": seen, "action": action, "reward": action, "next_seen": seen, "ended": ended})
    with torch.no_grad():
        worth, chosen = loop.critics[0](torch.cat([seen, action], 1)), loop.actor(seen)
    assert float((worth - action).abs().max()) < 0.2
    assert float(chosen.min()) > 0.9


def test_sizes_are_those_of_the_recipe():
    settings = TrainingSettings()
    assert settings.hidden == (peers.HIDDEN, peers.HIDDEN)
    assert (training_loop.HIDDEN, training_loop.BATCH) == (peers.HIDDEN, peers.BATCH)
    assert settings.batch_size == peers.BATCH
    assert (training_loop.DISCOUNT, training_loop.EXPLORATION_STD) == (peers.DISCOUNT, peers.EXPLORATION_STD)


@pytest.mark.parametrize("algorithm", training.ALGORITHMS)
def test_multiply_adds_are_those_that_torch_counts(algorithm):
    from torch.utils.flop_counter import FlopCounterMode

    h, batch = peers.HIDDEN, peers.BATCH

    def net(meets):
        return [torch.ones(shape, requires_grad=True) for shape in ((3, h), (h + meets, h), (h, 1))]

    def act(actor):
        return torch.relu(torch.relu(seen @ actor[0]) @ actor[1]) @ actor[2]

    def value(critic, action):
        return torch.relu(torch.cat([torch.relu(seen @ critic[0]), action], 1) @ critic[1]) @ critic[2]

    def count(work):
        with FlopCounterMode(display=False) as counter:
            work()
        return counter.get_total_flops()

    actor, critic, seen, action = net(0), net(1), torch.ones(batch, 3), torch.ones(batch, 1)
    critics, delay = (2, 2) if algorithm == "td3" else (1, 1)
    target = count(lambda: act(actor)) + critics * count(lambda: value(critic, action))
    of_critic = count(lambda: torch.autograd.grad(value(critic, action).sum(), critic))
    of_actor = count(lambda: torch.autograd.grad(value(critic, act(actor)).sum(), actor))
    # Where action and hidden layer meet, torch forms both gradients; a critic needs the one, and an actor the other.
    of_critic, of_actor = of_critic - 2 * batch * h, of_actor - 2 * batch * h * h
    assert training.flops(algorithm) == target + critics * of_critic + of_actor // delay


def test_ratios_are_to_the_peers_on_the_same_algorithm_and_missed_ones_are_named():
    rows = training.with_ratios(
        [
            row("native avx2", 2900.0),
            row(training.TORCH, 1500.0),
            row(training.SB3, 100.0),
            row(training.SBX, 200.0),
            row(training.SB3, 5000.0, algorithm="ddpg"),
        ],
        1e12,
    )
    assert rows[0]["times"] == {training.SB3: 29.0, training.SBX: 14.5, training.LOOP: None}
    assert rows[0]["share_of_peak"] == pytest.approx(2900 * training.flops("td3") / 1e12)
    assert training.missed_ratios(rows) == ["td3: native avx2 is 29 times as fast as stable-baselines3, wanted: 30"]


def test_a_ratio_without_its_peer_is_not_reached_and_a_failure_of_ours_is_named():
    rows = training.with_ratios(
        [
            row(training.TORCH, 1500.0),
            row("native avx2", name=training.NATIVE, failure="boom"),
            row(training.SB3, failure="not installed (No module named stable_baselines3)"),
        ],
        None,
    )
    assert training.missed_ratios(rows) == ["td3: torch has no stable-baselines3 to be held against"]
    assert training.failures(rows) == ["td3: native avx2: boom"]


class Pretend:
    """Answers as a runner whose study takes 6 s to start and 2 cores and 1e-4 s for a step; now and then much more."""

    def __init__(self, *disturbed):
        self.disturbed = iter(disturbed)

    def run(self, one, algorithm):
        wall = 8 * one.steps * 1e-4 * next(self.disturbed)
        about = {"instruction_set": "avx2", "start_s": 6.0}
        return {"wall_s": wall, "cpu_s": 2 * wall, "seeds": 8, "steps": one.steps, "more": about}


def test_the_study_is_extrapolated_from_what_a_step_takes_and_starting_up_is_counted_once():
    study = training.extrapolate(Pretend(1.5, 1, 2), 5000, 3)
    least_min = (6 + 1e-4 * 200 * 500_000) / 60
    assert study["study_least_min"] == study["study_undisturbed_min"] == pytest.approx(least_min)
    assert study["study_min"] == pytest.approx((6 + 1.5e-4 * 200 * 500_000) / 60)
    assert "would take 250 min of wall time on two cores (median; least: 167)" in "\n".join(
        training.in_words("left out", study, None)
    )
    assert training.missed_study("not there", study) == [
        "two threads: not there",
        "the study takes 167 min, wanted: under 45",
    ]


@pytest.mark.skipif(not any(isa.runs_here for isa in isas()), reason="the native engine is not there")
def test_the_study_is_timed_in_workers_that_have_started():
    runner = training.Runner(sys.executable)
    done = runner.run(training.Contender(training.STUDY, training.STUDY, 3000, rows=200), "ddpg")
    assert not isinstance(done, str), done
    assert (done["seeds"], done["steps"], done["updates"]) == (8, 3000, 3000)
    assert 0 < done["cpu_s"] < 60
    assert done["wall_s"] > 0
    assert done["more"]["start_s"] > 0


def test_a_peer_that_is_not_installed_or_does_other_work_is_named(tmp_path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho No module named sbx >&2\nexit 3\n")
    python.chmod(0o755)
    sbx = training.Contender(training.SBX, training.SBX, 100)
    assert training.Runner(str(python)).run(sbx, "td3") == "not installed (No module named sbx)"
    python.write_text("#!/bin/sh\necho '{\"updates\": 50}'\n")
    assert training.Runner(str(python)).run(sbx, "td3") == "50 gradient steps instead of 100"


def test_it_prints_a_table_and_writes_everything(tmp_path):
    command = [sys.executable, "-W", "error", str(FOLDER / "training.py"), "--steps", "200", "--peer-steps", "100"]
    command += [
        "--rounds",
        "1",
        "--study-steps",
        "0",
        "--algorithms",
        "td3",
        "--only",
        "torch",
        "CleanRL",
        "env",
        "sbx",
        "--json",
        str(tmp_path / "out.json"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    ran = {one["contender"] for one in result["rows"] if not one["failure"]}
    assert {training.TORCH, training.LOOP, training.ENVIRONMENT} <= ran
    for one in result["rows"]:
        assert f"| {one['algorithm']} | {one['contender']} | " in done.stdout
    for name in ("cpu", "torch", "numpy", "gymnasium", "maglev-offline"):
        assert f"{name}: {result['machine'][name]}\n" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(("--steps", "5"), "--steps must be 100 or more, not 5"), (("--rounds", "0"), "--rounds must be 1 or more")],
)
def test_sizes_that_will_not_do_are_refused(arguments, words, capsys):
    with pytest.raises(SystemExit):
        training.options(list(arguments))
    assert words in capsys.readouterr().err
