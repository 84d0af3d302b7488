"""What trains a block of seeds: one interface, two engines, and the choice between them.

`torch` is the specification: `ddpg.py` and `td3.py` as they stand, on any device. `native` is a kernel of the same
update in C++, which trains each seed by itself. Both take their random numbers from the same streams in the same order.
"""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from maglev_offline.agents.settings import Algorithm, EngineChoice, TrainingSettings
from maglev_offline.control.simulate import Trajectory
from maglev_offline.errors import InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
Nets = dict[str, NDArray[np.float32]]
Engine = Literal["torch", "native"]


class Learner(Protocol):
    """A block of seeds of one algorithm that learn side by side. Seeds are the leading axis, critics before it."""

    @property
    def step(self) -> int:
        """Decisions that every seed has made."""

    def advance(self, steps: int) -> None:
        """Make so many decisions with every seed, each followed by a gradient step once the exploration is over.

        Any split of a run into calls gives the same bits.
        """

    def actors(self) -> Nets:
        """The actors now, with the names of `networks.py`, shapes [seeds, ...]."""

    def critics(self) -> Nets:
        """The critics now, with the names of `networks.py`, shapes [critics, seeds, ...]."""

    def responses(self, starts_m: Array) -> Trajectory:
        """Let the actors regulate from all starts [n] for one episode, without noise: columns [seeds x n].

        A seed's response does not depend on the seeds beside it.
        """

    def new_rows(self) -> NDArray[np.float32]:
        """Packed rows [n, seeds, WIDTH] that were added since the last call, in the order of time."""

    def state(self) -> dict[str, NDArray[Any]]:
        """All that is needed to go on, but for the rows: networks, optimisers, environment, streams, counters."""

    def restore(self, state: Mapping[str, NDArray[Any]], rows: NDArray[np.float32]) -> None:
        """Go on where `state` was taken; `rows` [n, seeds, WIDTH]: all that were added by then, or the last of them."""


class Choice(NamedTuple):
    """The engine that is taken, and why."""

    engine: Engine
    why: str


def choose_engine(requested: EngineChoice) -> Choice:
    """Take the engine that was asked for; `auto` is the native one where it can run.

    Raises
    ------
    InputError: the native engine was asked for and cannot run here.
    """
    if requested == "torch":
        return Choice("torch", "it was asked for")
    able, reason = native_availability()
    if able:
        return Choice("native", "it was asked for" if requested == "native" else f"it is the faster one ({reason})")
    if requested == "native":
        raise InputError(
            f"the native engine cannot run here: {reason}.",
            where="--engine native",
            todo="Take --engine torch, or install the package where a C++ compiler is.",
        )
    return Choice("torch", f"the native one cannot run here: {reason}")


def native_availability() -> tuple[bool, str]:
    """Whether the native engine can run here, and its instruction set or what is in its way."""
    try:
        from maglev_offline.agents.native_library import availability
    except ImportError:
        return False, "it is not part of this installation"
    return availability()


def make_learner(
    engine: Engine,
    algorithm: Algorithm,
    seeds: list[int],
    plant: Plant,
    mdp: Mdp,
    settings: TrainingSettings,
    prefill: NDArray[np.float32] | None = None,
    *,
    threads: int = 1,
) -> Learner:
    """Start a block of seeds; `prefill`: packed rows [n, WIDTH]. `threads` are used by the native engine only."""
    import torch

    torch.set_num_threads(1)  # small matrices, in watching the native engine too: threads get into each other's way
    if engine == "native":
        from maglev_offline.agents.native import NativeLearner

        return NativeLearner(algorithm, seeds, plant, mdp, settings, prefill, threads=threads)
    from maglev_offline.agents.torch_engine import TorchLearner

    return TorchLearner(algorithm, seeds, plant, mdp, settings, prefill)


def provenance(engine: Engine) -> dict[str, str]:
    """What else the bits of a run depend on: the instruction set that is used, and the compiler of what uses it."""
    if engine == "native":
        from maglev_offline.agents.native_library import kernel

        found = kernel()
        return {"instruction_set": found.isa.name, "compiler": found.compiler}
    import torch

    compiler = torch.__config__.show().splitlines()[1].strip(" -")
    return {"instruction_set": torch.backends.cpu.get_cpu_capability(), "compiler": compiler}
