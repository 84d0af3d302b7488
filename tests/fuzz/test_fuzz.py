"""Files that a user may be handed, changed at random: used or refused in words, in time, nothing lost in silence."""

import ast
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
PACKAGE = HERE.parents[1] / "maglev_offline"
NAMES = ("mcap", "messages", "recipe", "plant", "prefill", "sb3", "checkpoint", "policy", "manifest", "remembered")
FEW = {"mcap": 30, "messages": 30}
"""Mutants of each target in CI; 40 where nothing is said. `make fuzz` reads many more."""

SHARE = {"mcap": 0.02, "messages": 0.02}
"""Of the mutants of `make fuzz`, what falls to targets that take 20 times as long; the others share the rest."""

FOUND = [line.split() for line in (HERE / "found.txt").read_text().splitlines() if not line.startswith("#")]


def module(name):
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    made = importlib.util.module_from_spec(spec)
    sys.modules[name] = made
    spec.loader.exec_module(made)
    return made


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    """Read one mutant of a target in this process."""
    module("mutators")
    worker, targets = module("worker"), module("targets").all_targets(tmp_path_factory.mktemp("whole"))
    folder = tmp_path_factory.mktemp("mutant")
    return lambda name, number: worker.one(targets[name], name, number, folder)


@pytest.mark.parametrize("name", NAMES)
def test_some_mutants(read, name):
    ended = {read(name, number) for number in range(FEW.get(name, 40))}
    assert ended <= {"used", "used in part", "refused", "none"}
    assert "refused" in ended
    assert read(name, None) == "used", "a file as it was written"


@pytest.mark.parametrize(("name", "number"), FOUND)
def test_mutants_that_found_something(read, name, number):
    assert read(name, int(number)) in {"used", "used in part", "refused", "none"}


@pytest.mark.fuzz
@pytest.mark.parametrize("name", NAMES)
def test_many_mutants(name, tmp_path):
    """The target's share of FUZZ mutants, from number FUZZ_FROM on, 10 s and 1 GB at most each."""
    first, total = int(os.environ.get("FUZZ_FROM", "0")), int(os.environ.get("FUZZ", "20000"))
    count = round(total * SHARE.get(name, (1 - sum(SHARE.values())) / (len(NAMES) - len(SHARE))))
    wrong = {}
    for start in range(first, first + count, 20_000):
        last = min(start + 20_000, first + count)
        while start < last:
            command = [sys.executable, str(HERE / "worker.py"), name, str(start), str(last), str(tmp_path)]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode == 0:
                told = json.loads(done.stdout.splitlines()[-1])
                print(f"{name} {start} to {last}: {told['ended']}")
                wrong |= told["wrong"]
                break
            at = int((tmp_path / "at").read_text())
            wrong[at] = f"the process ended with {done.returncode}: {done.stderr[-300:]}"
            start = at + 1
    assert wrong == {}


def calls(path):
    """Names of what a module calls, such as `torch.load`, and of what it imports, by whatever name it calls it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func)
        elif isinstance(node, ast.ImportFrom):
            yield f"import {node.module}"
            yield from (f"{node.module}.{name.name}" for name in node.names)
        elif isinstance(node, ast.Import):
            yield from (f"import {name.name}" for name in node.names)


UNPICKLES = {
    "np.load", "numpy.load", "torch.load", "joblib.load", "pd.read_pickle", "pandas.read_pickle", "import pickle",
    "import dill", "import cloudpickle", "import shelve", "import marshal", "eval", "exec",
}  # fmt: skip


def test_no_module_loads_a_pickle_or_runs_what_it_reads():
    found = [f"{path.name}: {name}" for path in PACKAGE.rglob("*.py") for name in calls(path) if name in UNPICKLES]
    assert found == []
