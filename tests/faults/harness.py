"""Runs commands with faults in them, and compares what is left in a workspace with that of an undisturbed run."""

import contextlib
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from maglev_offline.workspace import Manifest, changed_files

RECIPE = """
name = "faults"
[mdp]
episode_duration_s = 0.1
[curate]
target_rows = 100
[control]
duration_s = 0.3
start_gaps_m = [0.01]
robustness_cells = 2
robustness_duration_s = 0.1
[training]
algorithms = ["ddpg"]
seeds = 2
block = 1
steps = 120
exploratory_steps = 60
batch_size = 8
hidden = [4, 4]
[evaluation]
every_steps = 30
start_gaps_m = [0.006, 0.015]
selection_gaps_m = [0.01]
[transfer]
first_evaluations = 1
last_evaluations = 1
resamples = 100
"""

STAGES = {
    "surrogate": ("surrogate", "logs", "--logs", "2", "--points", "1", "--duration-s", "8"),
    "ingest": ("ingest", "logs", "--recipe", "recipe.toml", "--jobs", "1"),
    "prefill": ("prefill", "--algo", "ddpg", "--format", "npz"),
    "curate": ("curate", "--construction", "semi_markov"),
    "control": ("control",),
    "train": ("train", "--jobs", "1"),
    "transfer": ("transfer", "--jobs", "1"),
    "card": ("card", "--out", "card"),
    "report": ("report",),
    "export": ("policy", "export", "--arm", "empty", "--seed", "0", "--format", "safetensors", "--out", "policy.st"),
}
"""The road, each command on what those before it left; `curate` with another construction, so that it has work."""

NOT_COMPARED = (".lock", ".known_hashes.json")


@dataclass
class Ended:
    """How a command ended: exit code (negative: the signal) and what it said."""

    code: int
    out: str
    err: str


class Nursery:
    """The process that forks commands; see `nursery.py`."""

    def __init__(self, scratch: Path) -> None:
        here = Path(__file__).with_name("nursery.py")
        root = Path(__file__).parents[2]
        known = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(root), "PYTHONWARNINGS": "ignore"}
        for name in ("MAGLEV_OFFLINE_WORKSPACE", "MAGLEV_OFFLINE_DEBUG"):
            known.pop(name, None)
        self._out, self._runs = scratch, 0
        self._process = subprocess.Popen(
            [sys.executable, str(here)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=known
        )
        assert self._line() == "ready"

    def run(self, cwd: Path, *argv: str, kill_after_s: float | None = None, **fault) -> Ended:
        """Run a command in `cwd`; `kill_after_s`: SIGKILL so many seconds after it began."""
        out = self._order(cwd, argv, fault, wait=True)
        process = int(self._line())
        timer = threading.Timer(kill_after_s, _kill, [process]) if kill_after_s is not None else None
        if timer:
            timer.start()
        ended = self._ended(out)
        if timer:
            timer.cancel()
        return ended

    def stop(self, cwd: Path, *argv: str, at: int) -> int:
        """Run a command up to a step and stop it there; returns its process id. `go_on` lets it end."""
        self._stopped = self._order(cwd, argv, {"kind": "stop", "at": at}, wait=False)
        process = int(self._line())
        assert self._line() == "stopped"
        return process

    def meanwhile(self, cwd: Path, *argv: str) -> Ended:
        """Run a command while another is stopped."""
        return self._ended(self._order(cwd, argv, {}, wait=True))

    def go_on(self) -> Ended:
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return self._ended(self._stopped)

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def _order(self, cwd, argv, fault, *, wait):
        self._runs += 1
        out = self._out / f"run-{self._runs}"
        fault = {name: str(value) if isinstance(value, Path) else value for name, value in fault.items()}
        order = {"argv": list(argv), "cwd": str(cwd), "out": str(out), "fault": fault, "wait": wait}
        self._process.stdin.write(json.dumps(order) + "\n")
        self._process.stdin.flush()
        return out

    def _ended(self, out):
        code = int(self._line())
        texts = [Path(f"{out}.{name}") for name in ("stdout", "stderr")]
        ended = Ended(code, *(path.read_text() if path.exists() else "" for path in texts))
        for path in texts:
            path.unlink(missing_ok=True)
        return ended

    def _line(self) -> str:
        return self._process.stdout.readline().strip()


def _kill(process):
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)


class Road:
    """Folders as they are before and after each undisturbed command, made when they are asked for."""

    def __init__(self, home: Path, nursery: Nursery) -> None:
        self.home, self.nursery = home, nursery
        self._made: list[str] = []
        first = home / "before-surrogate"
        first.mkdir()
        (first / "recipe.toml").write_text(RECIPE)

    def before(self, stage: str) -> Path:
        """The folder that a stage finds."""
        names = list(STAGES)
        for number, name in enumerate(names[: names.index(stage)]):
            if name not in self._made:
                following = self.home / f"before-{names[number + 1]}"
                shutil.copytree(self.home / f"before-{name}", following)
                ended = self.nursery.run(following, *STAGES[name])
                assert ended.code == 0, (name, ended.err)
                self._made.append(name)
        return self.home / f"before-{stage}"

    def copy(self, stage: str, to: Path) -> Path:
        """A copy of the folder that a stage finds, in the place of whatever is at `to`."""
        shutil.rmtree(to, ignore_errors=True)
        return Path(shutil.copytree(self.before(stage), to))

    def undisturbed(self, stage: str) -> dict[str, str]:
        """Digest of the folder that a stage leaves."""
        names = list(STAGES)
        if stage != names[-1]:
            return digest(self.before(names[names.index(stage) + 1]))
        path = self.home / f"digest-{stage}.json"
        if not path.exists():
            folder = self.copy(stage, self.home / "undisturbed")
            ended = self.nursery.run(folder, *STAGES[stage])
            assert ended.code == 0, ended.err
            path.write_text(json.dumps(digest(folder)))
        return json.loads(path.read_text())

    def steps(self, stage: str) -> int:
        """How many steps a stage takes."""
        path = self.home / f"{stage}.steps"
        if not path.exists():
            self.nursery.run(self.copy(stage, self.home / "counted"), *STAGES[stage], kind="count", count_to=path)
        return int(path.read_text())


def digest(folder: Path) -> dict[str, str]:
    """Hash of every file, and the names of all folders, but for locks and hashes that are kept."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.name not in NOT_COMPARED:
            name = path.relative_to(folder).as_posix()
            found[name] = "folder" if path.is_dir() else hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def half_written(folder: Path) -> list[str]:
    """Artefacts and files under their final names that are not what was written there."""
    found = []
    for path in folder.rglob("manifest.json"):
        if not any(part.startswith(".") for part in path.relative_to(folder).parts):
            found += [f"{path.parent.name}/{name}" for name in changed_files(path.parent, Manifest.read(path.parent))]
    return found


def points(steps: int, most: int, seed: int) -> list[int]:
    """Steps to be tried: all of them, or so many at random."""
    if steps <= most:
        return list(range(1, steps + 1))
    return sorted(random.Random(seed).sample(range(1, steps + 1), most))
