"""The benchmark of simulation: it runs, its contenders simulate the same thing, and a missed floor is an error."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.nightly

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "simulation.py"
TINY = ("--episodes", "12", "--steps", "20", "--peer-episodes", "2", "--rounds", "2")
PEERS = ["gymnasium, one env", "solve_ivp, one by one"]
OURS = ["SuspensionBatch", "SuspensionBatch", "step, numpy", "step, torch", "solve_ivp, one system"]


def benchmark(*arguments):
    """In a process of its own: it sets the number of threads before numpy is loaded."""
    command = [sys.executable, "-W", "error", str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | {"COLUMNS": "200"})


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """What it prints, and what it writes."""
    path = tmp_path_factory.mktemp("benchmark") / "out.json"
    done = benchmark(*TINY, "--json", str(path))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout, json.loads(path.read_text(encoding="utf-8"))


def by_name(rows, name, integrator):
    return [row for row in rows if (row["contender"], row["integrator"]) == (name, integrator)]


def test_every_contender_has_a_row_for_both_control_periods(tiny):
    _, result = tiny
    for period in (1, 10):
        names = [row["contender"] for row in result["rows"] if row["period_ms"] == period]
        assert sorted(names) == sorted(OURS + PEERS)
    for row in result["rows"]:
        assert row["episodes"] == (2 if row["contender"] in PEERS else 12)
        assert 0 < row["slowest_per_s"] <= row["steps_per_s"] <= row["fastest_per_s"]
        assert row["all_episodes_s"] == pytest.approx(12 * 20 / row["steps_per_s"])
    assert result["complaints"] == []


def test_ratios_are_over_the_batch_with_the_same_integrator(tiny):
    rows = tiny[1]["rows"]
    for name, integrator in (("gymnasium, one env", "euler"), ("solve_ivp, one by one", "rk4")):
        for own, ours in zip(
            by_name(rows, name, integrator), by_name(rows, "SuspensionBatch", integrator), strict=True
        ):
            assert own["batch_over_it"] == pytest.approx(ours["steps_per_s"] / own["steps_per_s"])


def test_the_page_names_the_machine_and_prints_the_table(tiny):
    text, result = tiny
    for name in ("cpu", "python", "numpy", "scipy", "torch", "gymnasium", "maglev-offline"):
        assert f"{name}: {result['machine'][name]}\n" in text
    cells = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    assert len(cells) == 1 + len(result["rows"])
    assert [(c[0], c[1]) for c in cells[1:]] == [(f"{r['period_ms']} ms", r["contender"]) for r in result["rows"]]


def test_one_environment_ends_exactly_where_the_batch_does(tiny):
    assert [row["difference"] for row in by_name(tiny[1]["rows"], "gymnasium, one env", "euler")] == [0.0, 0.0]


@pytest.mark.parametrize("name", ["solve_ivp, one by one", "solve_ivp, one system"])
def test_solve_ivp_ends_where_the_batch_with_rk4_does(tiny, name):
    """Within 1e-5 of a scale; the two integrators are more than 0.05 apart, so this could fail."""
    rows = tiny[1]["rows"]
    apart = by_name(rows, "SuspensionBatch", "rk4")
    for own, integrators in zip(by_name(rows, name, "rk4"), apart, strict=True):
        assert 0 < own["difference"] < 1e-5
        assert integrators["difference"] > 0.05


@pytest.mark.parametrize("kind", ["numpy", "torch"])
def test_raw_steps_end_where_the_batch_does(tiny, kind):
    for row in by_name(tiny[1]["rows"], f"step, {kind}", "euler"):
        assert row["difference"] < 1e-5


def test_a_missed_floor_is_named_and_exits_with_1():
    """Twelve magnets are far too few for the floors of ten thousand."""
    done = benchmark("--quick", *TINY)
    assert done.returncode == 1
    assert "SuspensionBatch at 1 ms makes" in done.stderr
    assert "floor: 20,000,000" in done.stderr
    assert "times as fast as solve_ivp, one by one, floor: 500" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--episodes", "0"), "--episodes must be 1 or more, not 0"),
        (("--steps", "25"), "--steps must be a multiple of 10, not 25"),
    ],
)
def test_sizes_that_will_not_do_are_refused(arguments, words):
    done = benchmark(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
