"""A trial of the engines in a process of its own: a library that crashes must not take the doctor with it."""

import importlib
import multiprocessing
import signal
import time
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

LONGEST_S = 120.0
"""A trial that takes longer is ended. PyTorch alone may take a minute to load from a cold network disk."""


class Native(NamedTuple):
    """The kernel: whether it runs here, or what is in its way; instruction sets as (name, runs here), slowest first."""

    here: bool
    why: str
    isa: str | None
    compiler: str | None
    isas: list[tuple[str, bool]]


class Torch(NamedTuple):
    """PyTorch as it loads; `device`: name of the first CUDA device, None where there is none."""

    version: str
    threads: int
    device: str | None


class Trained(NamedTuple):
    """A few steps that were trained: with which engine, why with that one, and in how many seconds."""

    engine: str
    why: str
    seconds: float


class Found(NamedTuple):
    """What the trial saw; a text says what failed in the place of what could not be seen."""

    native: Native | str
    torch: Torch | str
    trained: Trained | str


def look_at_native() -> Native:
    """The kernel, without running it."""
    from maglev_offline.agents.native_library import availability, isas, kernel

    here, why = availability()
    sets = [(isa.name, isa.runs_here) for isa in isas()]
    if not here:
        return Native(here, why, None, None, sets)
    return Native(here, why, kernel().isa.name, kernel().compiler, sets)


def look_at_torch() -> Torch:
    """PyTorch, loaded."""
    torch: Any = importlib.import_module("torch")
    device = torch.cuda.get_device_name(0) if torch.cuda.is_available() else None
    return Torch(str(torch.__version__), int(torch.get_num_threads()), device)


def train_a_little(choice: str) -> Trained:
    """Train TD3 for forty decisions, twenty of them with a gradient step, and see that the actor moved.

    Raises
    ------
    MaglevOfflineError: the engine cannot run here, or what it learned is no number or nothing.
    """
    import numpy as np

    from maglev_offline.agents.engine import choose_engine, make_learner
    from maglev_offline.agents.settings import TrainingSettings
    from maglev_offline.errors import MaglevOfflineError
    from maglev_offline.mdp import Mdp
    from maglev_offline.physics.parameters import Plant

    steps = 40
    settings = TrainingSettings.model_validate(
        {"steps": steps, "exploratory_steps": steps // 2, "batch_size": 8, "hidden": (8, 8), "engine": choice}
    )
    taken = choose_engine(settings.engine)
    start = time.perf_counter()
    learner = make_learner(taken.engine, "td3", [0], Plant(), Mdp(), settings)
    before = learner.actors()
    learner.advance(steps)
    after = learner.actors()
    if not all(np.isfinite(values).all() for values in after.values()):
        raise MaglevOfflineError("what it learned is no number.")
    if all(np.array_equal(before[name], values) for name, values in after.items()):
        raise MaglevOfflineError("it learned nothing.")
    return Trained(taken.engine, taken.why, time.perf_counter() - start)


def try_engines(choice: str, longest_s: float = LONGEST_S) -> Found:
    """Look at both engines and train a little with the one that `choice` ([training] engine) leads to."""
    context = multiprocessing.get_context("spawn")  # a copy of this process would bring its threads and libraries
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_look, args=(theirs, choice), daemon=True)
    process.start()
    theirs.close()
    seen: list[Any] = []
    ending, until = "", time.monotonic() + longest_s
    with ours:
        while len(seen) < len(Found._fields) and not ending:
            if not ours.poll(max(0.0, until - time.monotonic())):
                ending = f"it did not end within {longest_s:g} s"
                process.kill()
                break
            try:
                seen.append(ours.recv())
            except EOFError:
                process.join()
                ending = _ending(process.exitcode)
    process.join()
    unseen = ending and f"the trial failed here: {ending}"
    after = "not tried: the trial ended before"
    return Found(*(*seen, unseen, after, after)[: len(Found._fields)])


def _look(answers: Connection, choice: str) -> None:
    """In the other process: one answer after the other, so that those before a crash arrive."""
    for look in (look_at_native, look_at_torch, lambda: train_a_little(choice)):
        try:
            answer: Any = look()
        except Exception as error:  # whatever it is, it is the finding
            answer = str(error).strip() or type(error).__name__
        answers.send(answer)


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        return f"the process was ended by {signal.Signals(-code).name}"
    return f"the process ended with exit code {code}"
