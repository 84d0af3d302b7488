"""Rows that no log holds: of a random policy and of the PID, in the simulator where agents train."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.control.feedback import Controller
from maglev_offline.env import SuspensionBatch
from maglev_offline.mdp import STATE_NAMES, Mdp
from maglev_offline.physics.disturbance import force_noise
from maglev_offline.physics.parameters import Plant
from maglev_offline.streams import stream

Array = NDArray[np.float64]

BEGINS = pd.Timestamp("2024-01-01T08:00:00Z")
"""When the first decision of every episode is taken to be made: simulated rows have no time of their own."""


class RandomPolicy:
    """Uniform actions, each held for `hold` decisions: what agents do in their exploratory steps."""

    def __init__(self, rng: np.random.Generator, voltage_limit_v: float, hold: int) -> None:
        self._rng, self._limit, self._hold = rng, voltage_limit_v, hold

    def start(self, z: Array) -> tuple[int, Array]:
        """The first decision comes; no voltage is held yet."""
        return 0, np.zeros(len(z))

    def control(self, z: Array, memory: tuple[int, Array], dt_s: float) -> tuple[Array, tuple[int, Array]]:  # noqa: ARG002
        """A new voltage at every `hold`-th decision, the old one else."""
        age, v = memory
        if age % self._hold == 0:
            v = self._limit * self._rng.uniform(-1, 1, len(z))
        return v, (age + 1, v)


def simulated_rows(plant: Plant, mdp: Mdp, policy: Controller, rows: int, origin: str, seed: int) -> pd.DataFrame:
    """`rows` decisions of `policy` in episodes like those of an agent, as a table of transitions.

    All episodes run side by side, from the starts, with the random force and with the costs of the environment. Of the
    last episode only as many decisions are taken as are asked for. Columns are those of `constructions.rows.table_of`.
    """
    starts, forces = stream(seed, f"{origin}: starts"), stream(seed, f"{origin}: force")
    found = 0
    parts: list[pd.DataFrame] = []
    while found < rows:  # episodes that end at contact have fewer rows, so more of them are needed
        episodes = -(-(rows - found) // mdp.decisions_per_episode)
        part = _episodes(plant, mdp, policy, episodes, starts, forces)
        parts.append(part.assign(segment=part["segment"] + (parts[-1]["segment"].max() + 1 if parts else 0)))
        found += len(part)
    table = pd.concat(parts).sort_values(["segment", "step"], kind="stable").iloc[:rows].reset_index(drop=True)
    begins = BEGINS + pd.to_timedelta(table["step"] * mdp.control_period_ms, unit="ms")
    return table.assign(origin=origin, log_id=f"simulated {origin}", point="simulated", t=begins, substep=np.int32(0))


def _episodes(
    plant: Plant, mdp: Mdp, policy: Controller, episodes: int, starts: np.random.Generator, forces: np.random.Generator
) -> pd.DataFrame:
    """All rows of so many episodes, side by side; `segment` numbers the episodes."""
    decisions = mdp.decisions_per_episode
    batch = SuspensionBatch(plant, mdp, episodes)
    batch.reset(starts.uniform(*mdp.start_gap_m, episodes))
    period_s = mdp.plant_steps_per_decision * mdp.plant_step_s
    memory = policy.start(batch.deviation())
    parts, going = [], np.ones(episodes, dtype=bool)
    for k in range(decisions):
        state = batch.deviation()
        voltage, memory = policy.control(state, memory, period_s)
        voltage = np.clip(voltage, -mdp.voltage_limit_v, mdp.voltage_limit_v)
        force = force_noise(forces, (mdp.plant_steps_per_decision, episodes), mdp.force_noise_std_n)
        _, cost, touched = batch.step(process.action(mdp, voltage), force)
        ended = touched & mdp.terminate_on_contact
        part = pd.DataFrame(dict(zip(STATE_NAMES, state.T, strict=True)))
        part = part.assign(voltage_deviation_v=voltage, cost=cost)
        part = part.assign(**dict(zip((f"next_{name}" for name in STATE_NAMES), batch.deviation().T, strict=True)))
        part = part.assign(
            duration_s=period_s,
            discount=mdp.discount * ~ended,
            terminated=ended,
            truncated=(k == decisions - 1) & ~ended,
            segment=np.arange(episodes),
            step=k,
        )
        parts.append(part[going])
        going &= ~ended
    return pd.concat(parts)
