"""The stage: train arms, block of seeds by block of seeds, each block an artefact of its own."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import joblib
import numpy as np
import pandas as pd

from maglev_offline.agents.settings import Algorithm, EvaluationSettings, TrainingSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress, Ticker
from maglev_offline.tables import write_parquet
from maglev_offline.workspace import Manifest, Workspace, fingerprint, input_hash

if TYPE_CHECKING:  # torch takes seconds to import, and a finished study does not need it
    from maglev_offline.agents.training import Trained


class Arm(NamedTuple):
    """One arm of a study: an algorithm, the arm's name, and the prefill artefact it starts from, if any."""

    algorithm: Algorithm
    name: str
    prefill: Path | None

    @property
    def title(self) -> str:
        """Name of the arm's folder, for instance `td3-prefill`."""
        return f"{self.algorithm}-{self.name}"


class World(NamedTuple):
    """The recipe tables that training depends on."""

    plant: Plant
    mdp: Mdp
    training: TrainingSettings
    evaluation: EvaluationSettings


class _Task(NamedTuple):
    arm: Arm
    seeds: list[int]
    folder: Path
    mark: str
    inputs: dict[str, str]


def train_arms(
    workspace: Workspace, arms: list[Arm], world: World, *, jobs: int = 1, progress: Progress = SILENT
) -> tuple[dict[Arm, list[Path]], int]:
    """Train whatever is missing of the arms; return the block folders of each arm, and how many blocks were trained.

    A block that is in the workspace with the same inputs and recipe is taken as it is, so that an interrupted study
    goes on where it stopped, and more seeds only add blocks. Any number of `jobs` gives the same bytes.
    """
    tasks = [task for arm in arms for task in _tasks(workspace, arm, world)]
    folders = {arm: [task.folder for task in tasks if task.arm == arm] for arm in arms}
    missing = [task for task in tasks if not workspace.is_current(task.folder, task.mark)]
    if not missing:
        return folders, 0
    runs = sum(len(task.seeds) for task in missing)
    total = runs * world.training.steps
    progress.say(
        f"training: {runs} runs of {world.training.steps:,} steps, in {len(missing)} blocks of {world.training.block} "
        f"seeds; what is stopped goes on at its first unfinished block."
    )
    with progress.task("training", total, "steps") as tick, _tick_file(tick) as ticks:
        pool = joblib.Parallel(n_jobs=min(jobs, len(missing)), return_as="generator_unordered", batch_size=1)
        for number, trained in pool(
            joblib.delayed(_train)(number, task, world, ticks) for number, task in enumerate(missing)
        ):
            _commit(workspace, missing[number], world, trained)
    return folders, len(missing)


def _tasks(workspace: Workspace, arm: Arm, world: World) -> list[_Task]:
    seeds, block = world.training.seed_list, world.training.block
    inputs = {} if arm.prefill is None else {f"prefill/{arm.prefill.name}": input_hash(arm.prefill)}
    # What the block depends on is its own seeds, not how many there are in the study.
    shared = world.training.model_copy(update={"seeds": 1, "first_seed": 0, "algorithms": (arm.algorithm,)})
    tasks = []
    for start in range(0, len(seeds), block):
        group = seeds[start : start + block]
        folder = workspace.path("training", arm.title, f"seeds-{group[0]:04d}-{group[-1]:04d}")
        mark = fingerprint(
            "train", inputs, world.plant, world.mdp, shared, world.evaluation,
            algorithm=arm.algorithm, arm=arm.name, seeds=group,
        )  # fmt: skip
        tasks.append(_Task(arm, group, folder, mark, inputs))
    return tasks


def _train(number: int, task: _Task, world: World, ticks: Path) -> tuple[int, Trained]:
    from maglev_offline.agents.training import train_block
    from maglev_offline.replay.prefill import load_prefill, packed

    rows = None if task.arm.prefill is None else packed(load_prefill(task.arm.prefill))

    def tick(done: int) -> None:
        with ticks.open("ab") as file:
            file.write(done.to_bytes(8, "little"))

    trained = train_block(
        task.arm.algorithm, task.seeds, world.plant, world.mdp, world.training, world.evaluation, rows, tick
    )
    return number, trained


def _commit(workspace: Workspace, task: _Task, world: World, trained: Trained) -> None:
    from safetensors.numpy import save_file

    manifest = Manifest(f"training/{task.arm.title}/{task.folder.name}", task.mark, task.inputs)
    manifest.settings = {name: table.model_dump(mode="json") for name, table in world._asdict().items()}
    manifest.counts = {"seeds": len(task.seeds), "steps": world.training.steps, "evaluations": len(trained.curves)}
    final = trained.curves[trained.curves["env_step"] == world.training.steps]
    manifest.facts = {
        "algorithm": task.arm.algorithm,
        "arm": task.arm.name,
        "seeds": task.seeds,
        "engine": "torch",
        "block": world.training.block,
        "diverged_seeds": [int(s) for s in final.loc[final["diverged"], "seed"]],
    }
    with workspace.commit(task.folder, manifest) as draft:
        for name, table in (("curves", trained.curves), ("regulation", trained.regulation)):
            table = table.assign(algorithm=task.arm.algorithm, arm=task.arm.name)
            write_parquet(table, draft / f"{name}.parquet")
        for name, net in (("last", trained.last), ("best", trained.best)):
            save_file({key: np.ascontiguousarray(value) for key, value in net.items()}, draft / f"{name}.safetensors")


@contextmanager
def _tick_file(tick: Ticker) -> Iterator[Path]:
    """A file that workers append their progress to, read by a thread here: works across any kind of process."""
    handle, name = tempfile.mkstemp(prefix="maglev-offline-ticks-")
    os.close(handle)
    path, stop = Path(name), threading.Event()

    def watch() -> None:
        offset = 0
        while True:
            last_round = stop.wait(0.5)
            data = path.read_bytes()[offset:]
            whole = len(data) // 8 * 8
            for at in range(0, whole, 8):
                tick(int.from_bytes(data[at : at + 8], "little"))
            offset += whole
            if last_round:
                return

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield path
    finally:
        stop.set()
        thread.join()
        path.unlink(missing_ok=True)


def load_curves(folders: list[Path]) -> pd.DataFrame:
    """Read the learning curves of several blocks into one table."""
    return pd.concat([pd.read_parquet(folder / "curves.parquet") for folder in folders], ignore_index=True)
