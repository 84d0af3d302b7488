"""Surrogate logs made once, and a way to call the command line as the entry point does."""

import json
import os
import shutil
import sys
from dataclasses import dataclass

import pytest
from markupsafe import Markup

from maglev_offline import cli

TINY = """
name = "tiny"
logs = ["logs/*.mcap"]
[mdp]
episode_duration_s = 0.1
[curate]
target_rows = 200
[control]
duration_s = 0.5
start_gaps_m = [0.01]
robustness_cells = 3
robustness_duration_s = 0.2
[training]
algorithms = ["ddpg"]
seeds = 2
block = 2
steps = 200
exploratory_steps = 60
batch_size = 16
hidden = [8, 8]
[evaluation]
every_steps = 50
start_gaps_m = [0.006, 0.015]
selection_gaps_m = [0.01]
[transfer]
first_evaluations = 2
last_evaluations = 2
resamples = 200
[surrogate]
points = 2
duration_s = 30
"""


@dataclass
class Called:
    code: int
    out: str
    err: str

    @property
    def json(self):
        return json.loads(self.out)


@pytest.fixture
def call(monkeypatch, capsys):
    """Run a command line in this process, through the same function as the entry point."""

    def run(*arguments):
        capsys.readouterr()
        monkeypatch.setattr(sys, "argv", ["maglev-offline", *(str(a) for a in arguments)])
        code = cli.run()
        return Called(code, *capsys.readouterr())

    return run


@pytest.fixture(scope="session")
def surrogate_logs(tmp_path_factory):
    """Three logs, as `maglev-offline surrogate logs --points 2 --duration-s 30` writes them."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("surrogate") / "logs"
        patch.setattr(sys, "argv", ["maglev-offline", "surrogate", str(folder), "--points=2", "--duration-s=30", "-q"])
        assert cli.run() == 0
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch, surrogate_logs):
    """An empty current folder with the logs in `logs` and a recipe that takes seconds in `tiny.toml`."""
    shutil.copytree(surrogate_logs, tmp_path / "logs")
    (tmp_path / "tiny.toml").write_text(TINY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MAGLEV_OFFLINE_WORKSPACE", raising=False)
    monkeypatch.delenv("MAGLEV_OFFLINE_DEBUG", raising=False)
    # Worker processes outlive a test and stay in its folder: none, unless a test asks for them by absolute paths.
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    return tmp_path


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the figures of pages blank: to draw them is most of the work, and few tests look at them."""
    from maglev_offline.report import stage

    monkeypatch.setattr(stage, "drawn", lambda plot: Markup('<svg viewBox="0 0 1 1"></svg>'))
