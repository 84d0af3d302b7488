"""What the simulator makes of a logged stretch: from its first sample, with the logged voltages, to its last.

No construction is in it: samples as they were logged, absolute gap and current, whatever the set-point. Between two
samples the voltage is taken to lie on the line from one to the other. What it really did there no log says.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.curate.pairs import PLACE
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State, step
from maglev_offline.physics.parameters import Plant
from maglev_offline.streams import stream

Array = NDArray[np.float64]

STATE = ("gap_m", "gap_velocity_m_s", "current_a")

MOST_WINDOWS = 10_000
"""So many windows of one step are simulated, drawn by the seed, and of more steps so many fewer: all cost the same."""


@dataclass(frozen=True)
class Windows:
    """n windows of k + 1 samples that follow each other in a segment, all finite and out of contact, SI units.

    `state` and `later` [n, 3]: gap, gap velocity and current of the first and of the last sample; `voltage_v`
    [n, k + 1]; `duration_s` [n, k] between the samples; `set_point_m` [n] and `place` (the columns of
    `PLACE`) are of the first.
    """

    state: Array
    later: Array
    voltage_v: Array
    duration_s: Array
    set_point_m: Array
    place: pd.DataFrame

    def __len__(self) -> int:
        return len(self.state)


@dataclass(frozen=True)
class Recording:
    """All samples in order of log, point, segment and step, as arrays: what windows are cut from.

    `state` [m, 3], `voltage_v`, `set_point_m`, `t_ns` [m]; `segment` [m] numbers the segments of all points and logs,
    or the pieces that are drawn of them; `sound` [m]: finite, and out of contact; `place`: the columns of `PLACE`.
    """

    state: Array
    voltage_v: Array
    set_point_m: Array
    t_ns: NDArray[np.int64]
    segment: NDArray[np.int64]
    sound: NDArray[np.bool_]
    place: pd.DataFrame


def recording_of(samples: pd.DataFrame) -> Recording:
    """Lay a table of samples out; the order of its rows does not matter."""
    samples = samples.sort_values(["log_id", "point", "segment", "step"], kind="stable", ignore_index=True)
    values = samples[[*STATE, "voltage_v", "set_point_m"]].to_numpy(dtype=np.float64)
    group = samples.groupby(["log_id", "point", "segment"], sort=False).ngroup().to_numpy()
    breaks = (np.diff(group) != 0) | (np.diff(samples["step"].to_numpy()) != 1)
    return Recording(
        state=values[:, :3],
        voltage_v=values[:, 3],
        set_point_m=values[:, 4],
        t_ns=samples["t"].dt.as_unit("ns").to_numpy(dtype="datetime64[ns]").astype(np.int64),
        segment=np.concatenate([np.zeros(min(1, len(group)), dtype=np.int64), np.cumsum(breaks)]),
        sound=np.isfinite(values).all(axis=1) & ~samples["contact"].to_numpy(dtype=bool),
        place=samples[list(PLACE)],
    )


def windows_of(recording: Recording, steps: int, seed: int) -> Windows:
    """Windows of `steps` steps, at most `MOST_WINDOWS` over `steps` of them."""
    first = np.arange(max(0, len(recording.segment) - steps))
    whole = recording.segment[first] == recording.segment[first + steps]
    for ahead in range(steps + 1):
        whole &= recording.sound[first + ahead]
    first = first[whole]
    most = MOST_WINDOWS // steps
    if len(first) > most:
        chosen = stream(seed, f"curate: residual windows of {steps}").choice(len(first), most, replace=False)
        first = first[np.sort(chosen)]
    at = first[:, None] + np.arange(steps + 1)
    return Windows(
        state=recording.state[first],
        later=recording.state[first + steps],
        voltage_v=recording.voltage_v[at],
        duration_s=np.diff(recording.t_ns[at], axis=1) / 1e9,
        set_point_m=recording.set_point_m[first],
        place=recording.place.iloc[first].reset_index(drop=True),
    )


def predicted(windows: Windows, plant: Plant, mdp: Mdp) -> Array:
    """Where the simulator is at the end of each window, [n, 3] as `Windows.later`.

    It is that of the agents: the same integrator and stops. The time between two samples is cut into equal plant
    steps, no longer than the process's own; the voltage of each is that in its middle. No random force acts.
    """
    now = State(*windows.state.T)
    for k in range(windows.duration_s.shape[1]):
        duration_s = windows.duration_s[:, k]
        count = int(np.ceil(duration_s.max(initial=0.0) / mdp.plant_step_s - 1e-6))
        for number in range(count):
            share = (number + 0.5) / count
            voltage = (1 - share) * windows.voltage_v[:, k] + share * windows.voltage_v[:, k + 1]
            # `step` takes one number by its signature, and broadcasts: windows may differ in their length.
            now = step(plant, now, voltage, duration_s / count, integrator=mdp.integrator)  # type: ignore[arg-type]
    return np.stack(now, axis=-1)
