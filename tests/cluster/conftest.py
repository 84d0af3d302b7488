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
from typing import NamedTuple

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
        return self.until(lambda: next(iter(sorted(self.folder.glob(pattern))), None), seconds)

    def until(self, found, seconds=60):
        """Wait for something that is true, and give it."""
        return until(found, seconds)

    def copy(self, workspace, *parts):
        """A workspace with some of the artefacts that were made in one process."""
        for part in parts:
            shutil.copytree(self.folder / "alone" / part, self.folder / workspace / part)
        return workspace


def prepared(folder, *, logs, duration_s):
    """Samples and transitions of simulated logs, made in one process."""
    made = Place(folder)
    (made.folder / "recipe.toml").write_text(RECIPE)
    made.run("surrogate", "logs", "--logs", logs, "--points", 1, "--duration-s", duration_s, "-q")
    made.run("ingest", "logs", "--recipe", "recipe.toml", "--workspace", "alone", "--jobs", 1, "-q")
    made.run("curate", "--construction", "reconstructed", "--workspace", "alone", "--jobs", 1, "-q")
    return made


@pytest.fixture(scope="session")
def place(tmp_path_factory):
    made = prepared(tmp_path_factory.mktemp("clusters"), logs=3, duration_s=20)
    made.run("prefill", "--workspace", "alone", "-q")
    made.run("transfer", "--workspace", "alone", "--jobs", 1, "-q")
    return made


@pytest.fixture(scope="session")
def many_samples(tmp_path_factory):
    """19,760 samples in three logs; up to 16,384 are recovered in the command."""
    return prepared(tmp_path_factory.mktemp("many"), logs=3, duration_s=700)


class Cluster(NamedTuple):
    """A cluster of two workers with a thread each: the options that lead to it, and the programs that it is of."""

    name: str
    address: str
    programs: list[subprocess.Popen]

    @property
    def options(self):
        return ("--backend", self.name, "--scheduler", self.address)

    def tasks(self):
        """How often a task went from one state to another, which Dask alone counts."""
        if self.name != "dask":
            return None
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            return client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.transition_counter)

    def end_scheduler(self):
        """Kill the process that listens at the address: the scheduler of Dask, the control store of Ray."""
        import psutil

        first = psutil.Process(self.programs[0].pid)
        for process in (first, *first.children(recursive=True)):
            if self.name == "dask" or process.name().startswith("gcs_server"):
                process.kill()

    def at_work(self):
        """Processes of its workers that do tasks, or with Dask may do some."""
        import psutil

        found = []
        for program in self.programs:
            for process in psutil.Process(program.pid).children(recursive=True):
                with contextlib.suppress(psutil.NoSuchProcess):
                    command = " ".join(process.cmdline())
                    if "spawn_main" in command or command.startswith("ray::_done"):
                        found.append(process.pid)
        return found


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
        yield processes
    finally:
        for process in processes:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
        for process in processes:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


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


@contextlib.contextmanager
def cluster_of(name, folder):
    """A cluster with its logs in a folder, as long as the body lasts."""
    port = free_port()
    home = f"/tmp/r{port}"  # the sockets of Ray lie below, whose names may not be long
    if name == "dask":
        address = f"tcp://127.0.0.1:{port}"
        scheduler = ("dask", "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        worker = ("dask", "worker", address, "--nthreads", "1", "--nworkers", "2", "--no-dashboard")
        programs = [scheduler, worker]
    else:
        address = f"127.0.0.1:{port}"
        options = f"--head --block --port {port} --node-ip-address 127.0.0.1 --num-cpus 2 --include-dashboard=false"
        more = f"--ray-client-server-port {free_port()} --min-worker-port 0 --max-worker-port 0 --temp-dir {home}"
        programs = [("ray", "start", *options.split(), *more.split())]
    try:
        with running(*programs, folder=folder) as processes:
            until(lambda: listens(port))
            yield Cluster(name, address, processes)
    finally:
        shutil.rmtree(home, ignore_errors=True)


@pytest.fixture(scope="session", params=["dask", "ray"])
def cluster(request, tmp_path_factory):
    """A cluster that all tests of a session use, whatever they have done to its workers."""
    pytest.importorskip("distributed" if request.param == "dask" else "ray")
    with cluster_of(request.param, tmp_path_factory.mktemp(request.param)) as made:
        yield made


@pytest.fixture(params=["dask", "ray"])
def short_lived(request, tmp_path):
    """A cluster of one test, which may end its scheduler."""
    pytest.importorskip("distributed" if request.param == "dask" else "ray")
    with cluster_of(request.param, tmp_path) as made:
        yield made
