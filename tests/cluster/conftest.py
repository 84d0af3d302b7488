"""Clusters of two workers on this machine, and the road done in one process to hold their bytes against."""

import contextlib
import hashlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

RECIPE = """
name = "clusters"
[mdp]
episode_duration_s = 0.1
[curate]
target_rows = 100
[training]
algorithms = ["ddpg"]
seeds = 3
block = 1
steps = 2400
checkpoint_every = 1
exploratory_steps = 60
batch_size = 8
hidden = [8, 8]
[evaluation]
every_steps = 300
start_gaps_m = [0.006, 0.015]
selection_gaps_m = [0.01]
[transfer]
first_evaluations = 1
last_evaluations = 1
resamples = 100
"""

ENVIRONMENT = {
    **os.environ,
    "OMP_NUM_THREADS": "1",
    "PYTHONPATH": str(ROOT),
    "PYTHONWARNINGS": "ignore",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",  # 15 by default, which on a machine that is busy otherwise is never
}


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


@dataclass
class Place:
    """A folder with a recipe and logs, and what the commands made of them in one process."""

    folder: Path
    logs: int

    def begin(self, *argv, **more):
        command = [sys.executable, "-m", "maglev_offline", *map(str, argv)]
        known = {**ENVIRONMENT, **{name: str(value) for name, value in more.items()}}
        return subprocess.Popen(
            command, cwd=self.folder, env=known, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def run(self, *argv, code=0, **more):
        process = self.begin(*argv, **more)
        out, err = process.communicate(timeout=300)
        assert process.returncode == code, err
        return out + err

    def bytes_of(self, workspace):
        """Hash of every file of a workspace, but for those that begin with a dot."""
        home = self.folder / workspace
        names = {path.relative_to(home): path for path in sorted(home.rglob("*")) if path.is_file()}
        return {
            name.as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for name, path in names.items()
            if not any(part.startswith(".") for part in name.parts)
        }

    def first(self, pattern, seconds=60):
        """Wait for a path below the folder that fits the pattern."""
        return until(lambda: next(iter(sorted(self.folder.glob(pattern))), None), seconds)

    def copy(self, workspace, *parts):
        """A workspace with some of the artefacts that were made in one process."""
        for part in parts:
            shutil.copytree(self.folder / "alone" / part, self.folder / workspace / part)
        return workspace


@pytest.fixture(scope="session")
def place(tmp_path_factory):
    made = Place(tmp_path_factory.mktemp("clusters"), 3)
    (made.folder / "recipe.toml").write_text(RECIPE)
    made.run("surrogate", "logs", "--logs", made.logs, "--points", 1, "--duration-s", 20, "-q")
    made.run("ingest", "logs", "--recipe", "recipe.toml", "--workspace", "alone", "--jobs", 1, "-q")
    made.run("curate", "--construction", "reconstructed", "--workspace", "alone", "--jobs", 1, "-q")
    made.run("prefill", "--workspace", "alone", "-q")
    made.run("transfer", "--workspace", "alone", "--jobs", 1, "-q")
    return made


@contextlib.contextmanager
def running(*commands, folder):
    """Programs of this Python's environment, each in a process group of its own that ends with the body."""
    processes = []
    try:
        for number, command in enumerate(commands):
            with (folder / f"{Path(command[0]).name}-{number}.log").open("w") as log:
                program = [str(Path(sys.executable).with_name(command[0])), *command[1:]]
                processes.append(
                    subprocess.Popen(
                        program, cwd=folder, env=ENVIRONMENT, stdout=log, stderr=log, start_new_session=True
                    )
                )
        yield
    finally:
        for process in processes:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
        for process in processes:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def until(found, seconds=60):
    """Wait for something that is true, and give it."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        here = found()
        if here:
            return here
        time.sleep(0.01)
    raise TimeoutError(f"not within {seconds} s")


def listens(port):
    with contextlib.suppress(OSError):
        socket.create_connection(("127.0.0.1", port), 1).close()
        return True
    return False


@pytest.fixture(scope="session", params=["dask", "ray"])
def cluster(request, tmp_path_factory):
    """Options that lead to a cluster of two workers with a thread each."""
    pytest.importorskip("distributed" if request.param == "dask" else "ray")
    folder, port = tmp_path_factory.mktemp(request.param), free_port()
    if request.param == "dask":
        address = f"tcp://127.0.0.1:{port}"
        scheduler = ("dask", "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        worker = ("dask", "worker", address, "--nthreads", "1", "--nworkers", "2", "--no-dashboard")
        programs = [scheduler, worker]
    else:
        address = f"127.0.0.1:{port}"
        home = f"/tmp/r{port}"  # its sockets lie below, whose names may not be long
        options = f"--head --block --port {port} --node-ip-address 127.0.0.1 --num-cpus 2 --include-dashboard=false"
        more = f"--ray-client-server-port {free_port()} --min-worker-port 0 --max-worker-port 0 --temp-dir {home}"
        programs = [("ray", "start", *options.split(), *more.split())]
    with running(*programs, folder=folder):
        until(lambda: listens(port))
        yield ("--backend", request.param, "--scheduler", address)
