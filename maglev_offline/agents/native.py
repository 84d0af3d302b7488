"""The native engine: a C++ kernel of the same updates as `ddpg.py` and `td3.py`, which trains each seed by itself.

The kernel makes many steps of one seed in one call, in memory that is laid out as `native/layout.hpp` says, with
numbers drawn here from that seed's named streams; the seeds are spread over threads. So neither the seeds beside it,
nor the threads, nor the split of a run into calls changes a bit of a seed's numbers.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.agents.draws import Draws, DrawStreams
from maglev_offline.agents.engine import Nets
from maglev_offline.agents.native_arena import Arenas, aligned
from maglev_offline.agents.native_library import KernelDraws, KernelSettings, availability, kernel
from maglev_offline.agents.settings import Algorithm, TrainingSettings
from maglev_offline.control.simulate import Trajectory
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.buffer import WIDTH, check_prefill

__all__ = ["NativeLearner", "availability"]

Array = NDArray[np.float64]
Rows = NDArray[np.float32]

STEPS_AT_ONCE = 500
"""Steps of one call of the kernel, whose random numbers are drawn before it: a call costs as much as several steps,
and the first batch after it has not been asked for ahead."""

HUGE_PAGE_BYTES = 1 << 21
"""Batches are taken from all over a long replay: on whole huge pages the processor finds them faster."""


class NativeLearner:
    """A block of seeds; see `engine.Learner`. `prefill`: packed rows [n, WIDTH], which all seeds share.

    Raises
    ------
    InputError: the kernel cannot run here, or the prefill cannot be used.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        seeds: list[int],
        plant: Plant,
        mdp: Mdp,
        settings: TrainingSettings,
        prefill: Rows | None = None,
        threads: int = 1,
    ) -> None:
        self.mdp, self.threads = mdp, threads
        self.kernel = kernel()
        self._prefill = np.ascontiguousarray(np.empty((0, WIDTH)) if prefill is None else prefill, dtype=np.float32)
        capacity = min(settings.buffer_capacity, len(self._prefill) + settings.steps + 1)
        check_prefill(self._prefill, capacity)
        room = capacity - len(self._prefill)
        self._settings = kernel_settings(algorithm, plant, mdp, settings, prefilled=len(self._prefill), room=room)
        self._arenas = Arenas(len(seeds), self._settings, self.kernel.layout(self._settings))
        self._own = aligned((len(seeds), room, WIDTH), HUGE_PAGE_BYTES)
        self._streams = [
            DrawStreams(
                [seed],
                settings.batch_size,
                mdp.plant_steps_per_decision,
                mdp.force_noise_std_n,
                smoothed=algorithm == "td3",
            )
            for seed in seeds
        ]
        self._told = 0
        self._start(seeds, plant, settings)

    def _start(self, seeds: list[int], plant: Plant, settings: TrainingSettings) -> None:
        from maglev_offline.agents.ddpg import initial_networks

        nets = initial_networks(seeds, settings, critics=self._settings.critics, device="cpu")
        for kind, net in zip(("actor", "critic"), nets, strict=True):
            arrays = {name: value.detach().numpy() for name, value in net.items()}
            for group in (kind, f"slow_{kind}"):
                self._arenas.put(group, arrays)
        head, point = self._arenas.head, plant.equilibrium()
        head["gap_m"][:], head["current_a"][:] = point.gap_m, point.current_a
        head["age"][:] = self.mdp.decisions_per_episode

    @property
    def step(self) -> int:
        """Decisions that every seed has made."""
        return int(self._arenas.head["step"][0])

    def advance(self, steps: int) -> None:
        """Make so many decisions with every seed, and the gradient steps that belong to them."""

        def of_seed(index: int) -> None:
            for done in range(0, steps, STEPS_AT_ONCE):
                count = min(STEPS_AT_ONCE, steps - done)
                draws = self._streams[index].draw(count)
                kept, places = _places(draws)
                self.kernel.advance(
                    self._settings, self._arenas.floats[index], self._prefill, self._own[index], places, count
                )
                del kept

        self._each(of_seed)

    def _each(self, work: Callable[[int], None]) -> None:
        """Do the work of every seed, on as many threads as there are."""
        seeds = range(len(self._own))
        if self.threads == 1 or len(seeds) == 1:
            for index in seeds:
                work(index)
            return
        with ThreadPoolExecutor(min(self.threads, len(seeds))) as pool:
            works = [pool.submit(work, index) for index in seeds]
            try:
                for done in works:
                    done.result()
            finally:  # Ctrl-C does not wait for the seeds that have not begun
                for done in works:
                    done.cancel()

    def actors(self) -> Nets:
        """The actors now, [seeds, ...]."""
        return self._arenas.copied("actor")

    def critics(self) -> Nets:
        """The critics now, [critics, seeds, ...]."""
        return self._arenas.copied("critic")

    def responses(self, starts_m: Array) -> Trajectory:
        """Let the actors regulate from all starts [n] for one episode: columns [seeds x n]."""
        starts = np.ascontiguousarray(starts_m, dtype=np.float64)
        count, steps = len(starts), round(self.mdp.episode_duration_s / self.mdp.plant_step_s)
        states = np.empty((steps + 1, 3, len(self._own) * count))
        voltages_v = np.empty((steps, len(self._own) * count))

        def of_seed(index: int) -> None:
            mine = np.s_[..., index * count : (index + 1) * count]
            self.kernel.roll_out(self._settings, self._arenas.floats[index], starts, states[mine], voltages_v[mine])

        self._each(of_seed)
        time_s: Array = np.arange(steps + 1, dtype=np.float64) * np.float64(self.mdp.plant_step_s)
        return Trajectory(time_s, states[:, 0], states[:, 1], states[:, 2], voltages_v)

    def new_rows(self) -> Rows:
        """Rows [n, seeds, WIDTH] that were added since the last call, or the last of them that the ring still holds."""
        added, room = int(self._arenas.head["added"][0]), self._own.shape[1]
        slots = np.arange(max(self._told, added - room), added) % room
        self._told = added
        return np.ascontiguousarray(self._own[:, slots].swapaxes(0, 1))

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything but the rows."""
        nets = {
            f"{group}.{name}": value
            for group in self._arenas.nets
            for name, value in self._arenas.copied(group).items()
        }
        head = {f"head.{name}": value.copy() for name, value in self._arenas.head.items()}
        return {**nets, **head, "streams": np.concatenate([streams.state() for streams in self._streams], axis=1)}

    def restore(self, state: Mapping[str, NDArray[Any]], rows: Rows) -> None:
        """Go on where `state` was taken; `rows` [n, seeds, WIDTH] are all that were added by then, or the last."""
        for group, members in self._arenas.nets.items():
            self._arenas.put(group, {name: state[f"{group}.{name}"] for name in members[0]})
        for name, value in self._arenas.head.items():
            value[:] = state[f"head.{name}"]
        for index, streams in enumerate(self._streams):
            streams.restore(state["streams"][:, index : index + 1])
        self._told, room = int(self._arenas.head["added"][0]), self._own.shape[1]
        kept = rows[-room:]
        self._own[:, np.arange(self._told - len(kept), self._told) % room] = kept.swapaxes(0, 1)


def _places(draws: Draws) -> tuple[list[NDArray[Any]], KernelDraws]:
    """The addresses of a seed's numbers, and the arrays that must outlive the call."""
    parts = [draws.start, draws.exploration, draws.uniform_action, draws.batch, draws.smoothing, draws.force]
    arrays = [None if part is None else np.ascontiguousarray(part) for part in parts]
    addresses = [None if array is None else array.ctypes.data for array in arrays]
    return [array for array in arrays if array is not None], KernelDraws(*addresses)


def kernel_settings(
    algorithm: Algorithm, plant: Plant, mdp: Mdp, settings: TrainingSettings, *, prefilled: int, room: int
) -> KernelSettings:
    """The recipe as the kernel takes it; `room`: slots for a seed's own rows."""
    names = [field[0] for field in KernelSettings._fields_]
    tables = (settings, plant, mdp)
    values = {name: getattr(table, name) for table in tables for name in names if hasattr(table, name)}
    twin = algorithm == "td3"
    point = plant.equilibrium()
    values |= {
        "critics": 2 if twin else 1,
        "hidden_1": settings.hidden[0],
        "hidden_2": settings.hidden[1],
        "batch": settings.batch_size,
        "smoothing": twin,
        "policy_delay": settings.policy_delay if twin else 1,
        "hold": max(1, round(settings.exploratory_hold_ms / mdp.control_period_ms)),
        "prefilled": prefilled,
        "room": room,
        "prefill_decay_steps": settings.prefill_decay_steps or 0,
        "mixing_share": -1.0 if settings.mixing_share is None else settings.mixing_share,
        "set_point_m": point.gap_m,
        "equilibrium_current_a": point.current_a,
        "equilibrium_voltage_v": point.voltage_v,
        "plant_steps": mdp.plant_steps_per_decision,
        "decisions": mdp.decisions_per_episode,
        "rk4": mdp.integrator == "rk4",
        "start_low_m": mdp.start_gap_m[0],
        "start_high_m": mdp.start_gap_m[1],
    }
    return KernelSettings(**{name: values[name] for name in names})  # none is left at 0 because nobody gave it
