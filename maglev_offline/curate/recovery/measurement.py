"""What the sensors say of a state, and how sure they are."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.recovery.model import CURRENT, GAP, MEMORY, STATES, VELOCITY, Drive, Model
from maglev_offline.curate.recovery.tracks import Tracks

Array = NDArray[np.float64]

UNKNOWN = 1e3
"""Standard deviation of a signal that says nothing, in units of a large state."""


class Measured(NamedTuple):
    """n samples of four signals, each over its scale: `value` [n, 4] is `matrix` [n, 4, 5] x (x over the model's scale)
    + `offset` [n, 4], with the covariance `noise` [n, 4, 4]; `counts` [n]: how many of them say something."""

    value: Array
    offset: Array
    matrix: Array
    noise: Array
    counts: Array


def measured(model: Model, tracks: Tracks, x: Array, drive: Drive) -> Measured:
    """Linearise what is measured about the states x [n, 5] (SI units).

    All signals of a sample share one error of its stamp: each is off by its rate times that error, gap and current
    less the rate of the chord on which they were moved. That is the chord to the next sample where the message came
    early, and the one from the last sample where it came late: as often the one as the other, so half of each.
    """
    n, s, scale = len(tracks), model.settings, model.scale
    unit = np.array([scale[GAP], scale[VELOCITY], scale[CURRENT], 0.05 * model.mdp.voltage_limit_v])
    matrix = np.zeros((n, 4, STATES))
    for signal, state in enumerate((GAP, VELOCITY, CURRENT)):
        matrix[:, signal, state] = 1.0
    expected = np.stack([x[:, GAP], x[:, VELOCITY], x[:, CURRENT], np.zeros(n)], axis=1)
    expected[:, 3], free = model.voltage(x, drive, 0.0)
    gain = np.eye(STATES)[MEMORY] if model.gain is None else np.append(model.gain, 0.0)
    matrix[:, 3] = free[:, None] * gain * scale / unit[3]
    std = np.array([s.gap_std_m, s.velocity_std_m_s, s.current_std_a, s.voltage_std_v]) / unit
    says = np.isfinite(tracks.value) & ~tracks.bridged
    says[:, 3] &= free
    noise = np.where(says, std, UNKNOWN)[:, :, None] ** 2 * np.eye(4)
    for rates in _rates(model, tracks, x, drive):
        slip = rates * (s.stamp_std_share * model.period_s) / unit * (tracks.moved & says)
        noise = noise + slip[:, :, None] * slip[:, None, :] / 2
    value = np.where(says, tracks.value, expected) / unit
    offset = expected / unit - (matrix @ (x / scale)[:, :, None])[:, :, 0]
    return Measured(value, offset, matrix, noise, says.sum(axis=1).astype(np.float64))


def _rates(model: Model, tracks: Tracks, x: Array, drive: Drive) -> tuple[Array, Array]:
    """How fast the four signals change at the samples, less the rate of the chord ahead, and of that behind; [n, 4]."""
    dt_s = model.mdp.plant_step_s
    later = model.advance(x, drive, 0.0, dt_s)
    voltage = model.voltage(x, drive, 0.0)[0]
    rates = np.empty((len(x), 4))
    rates[:, :3] = (later - x)[:, :3] / dt_s
    rates[:, 3] = (model.voltage(later, drive, dt_s)[0] - voltage) / dt_s
    chord = np.diff(tracks.value, axis=0, append=np.nan) / model.period_s
    chord[:, 3] = 0.0  # the voltage is held
    last = np.append(tracks.chain[1:] != tracks.chain[:-1], True)[: len(x)]
    chord[last] = np.nan
    behind = np.concatenate([np.full((1, 4), np.nan), chord])[: len(x)]
    return rates - np.nan_to_num(chord), rates - np.nan_to_num(behind)
