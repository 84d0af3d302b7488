"""The training loop: a block of seeds of one algorithm and one arm, from empty or prefilled buffers, on any engine."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.agents.checkpoint import Checkpoint
from maglev_offline.agents.engine import Engine, Learner, make_learner
from maglev_offline.agents.record import Record, Trained
from maglev_offline.agents.settings import Algorithm, EvaluationSettings, TrainingSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import Ticker

WATCH_EVERY = 500
"""Steps from one look for divergence to the next."""


def train_block(
    algorithm: Algorithm,
    seeds: list[int],
    plant: Plant,
    mdp: Mdp,
    settings: TrainingSettings,
    evaluation: EvaluationSettings,
    prefill: NDArray[np.float32] | None = None,
    tick: Ticker | None = None,
    *,
    engine: Engine = "torch",
    threads: int = 1,
    checkpoint: Checkpoint | None = None,
    see: Callable[[pd.DataFrame], None] | None = None,
) -> Trained:
    """Train `seeds` (at most `settings.block`) side by side.

    `prefill`: packed rows [n, WIDTH] for the first slots of every buffer. `tick` counts the steps of seeds that are
    made here, `see` gets the rows of each evaluation. With a `checkpoint` the run goes on where that was saved, and
    ends in the same bits as one that was never stopped.

    Raises
    ------
    Unusable: the checkpoint is damaged, or is another run's.
    """
    learner = make_learner(engine, algorithm, seeds, plant, mdp, settings, prefill, threads=threads)
    record = Record(seeds, plant, mdp, evaluation, settings.critic_root_offset)
    if checkpoint is None or not _resume(checkpoint, learner, record, settings):
        _tell(see, record.take(learner))
    while learner.step < settings.steps:
        before = learner.step
        learner.advance(_next_stop(before, settings.steps, evaluation.every_steps) - before)
        record.watch(learner)
        on_grid = learner.step % evaluation.every_steps == 0
        if on_grid or learner.step == settings.steps:
            _tell(see, record.take(learner))
        if tick is not None:
            tick(len(seeds) * (learner.step - before))
        evaluations = learner.step // evaluation.every_steps
        due = on_grid and evaluations % settings.checkpoint_every == 0 and learner.step < settings.steps
        if checkpoint is not None and due:
            state = _prefixed("learner", learner.state()) | _prefixed("record", record.state())
            checkpoint.save(learner.step, state, learner.new_rows())
    return record.result()


def _next_stop(step: int, steps: int, every: int) -> int:
    """The step at which to look up next: the next evaluation, the next look for divergence, or the end."""
    return min(steps, (step // every + 1) * every, (step // WATCH_EVERY + 1) * WATCH_EVERY)


def _resume(checkpoint: Checkpoint, learner: Learner, record: Record, settings: TrainingSettings) -> bool:
    saved = checkpoint.load(most_rows=settings.buffer_capacity)
    if saved is None:
        return False
    learner.restore(_without("learner", saved.state), saved.rows)
    record.restore(_without("record", saved.state))
    return True


def _tell(see: Callable[[pd.DataFrame], None] | None, table: pd.DataFrame) -> None:
    if see is not None:
        see(table)


def _prefixed(group: str, state: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    return {f"{group}.{name}": value for name, value in state.items()}


def _without(group: str, state: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    return {name.removeprefix(f"{group}."): value for name, value in state.items() if name.startswith(f"{group}.")}
