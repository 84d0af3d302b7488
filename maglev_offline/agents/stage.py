"""The stage: train arms, block of seeds by block of seeds, each block an artefact of its own."""

from __future__ import annotations

from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from maglev_offline.agents.engine import Choice, choose_engine, provenance
from maglev_offline.agents.settings import Algorithm, EvaluationSettings, TrainingSettings
from maglev_offline.agents.ticks import FileTicker, tick_files
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress
from maglev_offline.spread import on_cluster, spread
from maglev_offline.tables import write_parquet
from maglev_offline.workspace import Manifest, Workspace, fingerprint, input_hash, package_versions

if TYPE_CHECKING:  # torch takes seconds to import, and a finished study does not need it
    from maglev_offline.agents.checkpoint import Checkpoint
    from maglev_offline.agents.record import Trained


class Arm(NamedTuple):
    """One arm of a study: an algorithm, the arm's name, and the prefill artefact it starts from, if any.

    `training`: how this arm learns, where it is otherwise than the world says; steps and seeds are the world's.
    """

    algorithm: Algorithm
    name: str
    prefill: Path | None
    training: TrainingSettings | None = None

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
    """One block to train: `from_step` is where its checkpoint goes on, `events` where its event files go, if any.

    `elsewhere`: on a cluster, where another worker, of another machine, may have begun it.
    """

    arm: Arm
    seeds: list[int]
    folder: Path
    mark: str
    inputs: dict[str, str]
    engine: Choice
    training: TrainingSettings
    threads: int = 1
    from_step: int = 0
    events: Path | None = None
    elsewhere: bool = False


def train_arms(
    workspace: Workspace,
    arms: list[Arm],
    world: World,
    *,
    jobs: int = 1,
    progress: Progress = SILENT,
    tensorboard: bool = False,
) -> tuple[dict[Arm, list[Path]], int]:
    """Train whatever is missing of the arms; return the block folders of each arm, and how many blocks were trained.

    A block that is in the workspace with the same inputs and recipe is taken as it is, so that more seeds only add
    blocks; one that was stopped goes on at its last checkpoint. Any number of `jobs` gives the same bytes, here and
    on a cluster, where a block takes one core. With `tensorboard` the evaluations also go to event files below
    `tensorboard/` in the workspace.

    Raises
    ------
    InputError: the recipe asks for the native engine, and it cannot run here.
    """
    engine = choose_engine(world.training.engine)
    tasks = [task for arm in arms for task in _tasks(workspace, arm, world, engine)]
    folders = {arm: [task.folder for task in tasks if task.arm == arm] for arm in arms}
    missing = []
    for task in tasks:
        if workspace.is_current(task.folder, task.mark):
            _forget_checkpoint(task)
        else:
            missing.append(task)
    if not missing:
        return folders, 0
    workers, elsewhere = min(jobs, len(missing)), on_cluster()
    threads = 1 if elsewhere or engine.engine != "native" else max(1, jobs // workers)
    missing = [
        task._replace(
            threads=threads,
            from_step=_looked_at(task, world, progress),
            events=workspace.path("tensorboard", task.arm.title) if tensorboard else None,
            elsewhere=elsewhere,
        )
        for task in missing
    ]
    progress.say(_announced(missing, world, engine))
    total = sum(len(task.seeds) * (world.training.steps - task.from_step) for task in missing)
    shared = workspace.root.absolute() if elsewhere else None
    with progress.task("training", total, "steps") as tick, tick_files(tick, shared) as counted:
        work = ((number, task, world, counted) for number, task in enumerate(missing))
        for number, trained, made_with in spread(_train, work, workers, in_order=False):
            _commit(workspace, missing[number], world, trained, made_with)
    return folders, len(missing)


def _tasks(workspace: Workspace, arm: Arm, world: World, engine: Choice) -> list[_Task]:
    seeds, block = world.training.seed_list, world.training.block
    inputs = {}
    if arm.prefill is not None:
        inputs[arm.prefill.relative_to(workspace.root).as_posix()] = input_hash(arm.prefill)
    # What the block depends on is its own seeds, not how many there are in the study, and the engine that is taken.
    training = arm.training or world.training
    shared = training.model_copy(
        update={"seeds": 1, "first_seed": 0, "algorithms": (arm.algorithm,), "engine": "auto", "checkpoint_every": 1}
    )
    tasks = []
    for start in range(0, len(seeds), block):
        group = seeds[start : start + block]
        folder = workspace.path("training", arm.title, f"seeds-{group[0]:04d}-{group[-1]:04d}")
        mark = fingerprint(
            "train", inputs, world.plant, world.mdp, shared, world.evaluation,
            algorithm=arm.algorithm, arm=arm.name, seeds=group, engine=engine.engine,
        )  # fmt: skip
        tasks.append(_Task(arm, group, folder, mark, inputs, engine, training))
    return tasks


def _announced(missing: list[_Task], world: World, engine: Choice) -> str:
    resumed = sum(task.from_step > 0 for task in missing)
    return (
        f"training: {sum(len(task.seeds) for task in missing)} runs of {world.training.steps:,} steps, in "
        f"{len(missing)} blocks of {world.training.block} seeds"
        f"{f', {resumed} of which go on at a checkpoint' if resumed else ''}. "
        f"Engine: {engine.engine}, because {engine.why}. What is stopped goes on at its last checkpoint."
    )


def _checkpoint(task: _Task) -> Checkpoint:
    """The checkpoint of a block, beside its place. Other versions or another machine's instructions round otherwise."""
    from maglev_offline.agents.checkpoint import Checkpoint

    made_with = sorted({**package_versions(), **provenance(task.engine.engine)}.items())
    mark = sha256(f"{task.mark} {made_with}".encode()).hexdigest()
    return Checkpoint(task.folder.parent / f".{task.folder.name}.partial", mark, len(task.seeds))


def _forget_checkpoint(task: _Task) -> None:
    """Remove the checkpoint of a finished block: a command may be killed after the one and before the other.

    One of another training of the same block, such as one of more steps that was stopped, stays.
    """
    checkpoint = _checkpoint(task)
    if checkpoint.folder.is_dir():
        with checkpoint.held():
            if checkpoint.is_ours():
                checkpoint.remove()


def _looked_at(task: _Task, world: World, progress: Progress) -> int:
    """The step at which the block's checkpoint goes on, 0 without one; one that cannot be used is told and removed."""
    from maglev_offline.agents.checkpoint import Unusable

    checkpoint = _checkpoint(task)
    if not checkpoint.folder.is_dir():
        return 0
    name = f"{task.arm.title}/{task.folder.name}"
    with checkpoint.held():
        try:
            saved = checkpoint.load(most_rows=1)
        except Unusable as why:
            progress.warn(f"the checkpoint of {name} is not used: {why}. That block is trained from its first step.")
            checkpoint.remove()
            return 0
    if saved is None:
        return 0
    progress.say(f"{name} goes on at step {saved.step:,} of {world.training.steps:,}.")
    return saved.step


def _train(number: int, task: _Task, world: World, tick: FileTicker) -> tuple[int, Trained, dict[str, str]]:
    """Train a block; return its number, what came of it, and what it was computed with."""
    from maglev_offline.agents.events import EventFiles
    from maglev_offline.agents.training import train_block
    from maglev_offline.replay.prefill import load_prefill, packed

    rows = None if task.arm.prefill is None else packed(load_prefill(task.arm.prefill))
    if task.elsewhere:
        task = task._replace(from_step=_looked_at(task, world, SILENT))
    with ExitStack() as stack:
        checkpoint = _checkpoint(task)
        stack.enter_context(checkpoint.held())
        events = None
        if task.events is not None:
            events = stack.enter_context(EventFiles(task.events, task.seeds, task.from_step))
        trained = train_block(
            task.arm.algorithm,
            task.seeds,
            world.plant,
            world.mdp,
            task.training,
            world.evaluation,
            rows,
            tick,
            engine=task.engine.engine,
            threads=task.threads,
            checkpoint=checkpoint,
            see=None if events is None else events.see,
        )
    return number, trained, provenance(task.engine.engine)


def _commit(workspace: Workspace, task: _Task, world: World, trained: Trained, made_with: dict[str, str]) -> None:
    from safetensors.numpy import save_file

    manifest = Manifest(f"training/{task.arm.title}/{task.folder.name}", task.mark, task.inputs)
    tables = world._replace(training=task.training)._asdict()
    manifest.settings = {name: table.model_dump(mode="json") for name, table in tables.items()}
    manifest.counts = {"seeds": len(task.seeds), "steps": world.training.steps, "evaluations": len(trained.curves)}
    manifest.facts = {
        "algorithm": task.arm.algorithm,
        "arm": task.arm.name,
        "seeds": task.seeds,
        "engine": task.engine.engine,
        "engine_why": task.engine.why,
        **made_with,
        "block": world.training.block,
        "diverged_seeds": list(trained.diverged_at),
        "diverged_at": {str(seed): step for seed, step in trained.diverged_at.items()},
    }
    with workspace.commit(task.folder, manifest) as draft:
        for name, table in (("curves", trained.curves), ("regulation", trained.regulation)):
            table = table.assign(algorithm=task.arm.algorithm, arm=task.arm.name)
            write_parquet(table, draft / f"{name}.parquet")
        for name, net in (("last", trained.last), ("best", trained.best)):
            save_file({key: np.ascontiguousarray(value) for key, value in net.items()}, draft / f"{name}.safetensors")
    _checkpoint(task).remove()


def load_curves(folders: list[Path]) -> pd.DataFrame:
    """Read the learning curves of several blocks into one table."""
    return pd.concat([pd.read_parquet(folder / "curves.parquet") for folder in folders], ignore_index=True)
