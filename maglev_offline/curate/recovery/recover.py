"""Chains of samples to smoothed states: guess, then shoot and smooth in turn."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.recovery.measurement import measured
from maglev_offline.curate.recovery.model import CURRENT, GAP, MEMORY, STATES, VELOCITY, Drive, Model
from maglev_offline.curate.recovery.shooting import whole_arc
from maglev_offline.curate.recovery.smoother import Smoothed, smooth
from maglev_offline.curate.recovery.tracks import Tracks

Array = NDArray[np.float64]

ITERATIONS = 4
"""So many times the motion is linearised anew. Most chains need two; swings of several mm from a start
need the others."""

MOST_MISSING = 3
"""Over more samples than this without a message, the way from before is no better a guess than a line."""


class Recovery(NamedTuple):
    """Chains and what was found at their samples; `about` [n, 5]: where the motion was linearised last (SI units).

    `explained` [chains]: the innovations are about as large as their covariance says. `nis_share` [chains]: their
    mean square over what it should be. `surprising` [n]: that sample's own are too large: a
    value is an old one, or a stop was met between the samples. `lost` [intervals]: the arc came near to a stop.
    """

    model: Model
    tracks: Tracks
    drive: Drive
    about: Array
    found: Smoothed
    explained: NDArray[np.bool_]
    nis_share: Array
    surprising: NDArray[np.bool_]
    lost: NDArray[np.bool_]

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """The intervals (in the order of `tracks.inner`) of explained chains, away from stops, with no surprise at
        either end."""
        inner = self.tracks.inner
        trusted: NDArray[np.bool_] = self.explained[self.tracks.chain[inner]]
        return trusted & ~self.lost & ~self.surprising[inner] & ~self.surprising[inner + 1]


def recover(model: Model, tracks: Tracks, iterations: int = ITERATIONS) -> Recovery:
    """Smooth the chains; what the plant does not explain comes out too, and is marked."""
    drive = drive_of(tracks)
    about = _shot_across(model, tracks, drive, first_guess(model, tracks))
    inner = tracks.inner
    for _ in range(iterations):
        arc = whole_arc(model, about[inner], drive.part(inner))
        said = measured(model, tracks, about, drive)
        found = smooth(tracks, about, arc, said, model.prior_std, model.scale)
        linearised, about = about, _sane(model, found.state * model.scale, about)
    share = _by_chain(tracks, found.nis) / np.maximum(_by_chain(tracks, said.counts), 1.0)
    finite: Array = np.isfinite(found.state.sum(axis=1)).astype(np.float64)
    explained: NDArray[np.bool_] = (_by_chain(tracks, finite) == tracks.length) & (
        share <= model.settings.most_innovation
    )
    surprising: NDArray[np.bool_] = ~(found.nis <= model.settings.most_innovation * np.maximum(said.counts, 1.0))
    return Recovery(model, tracks, drive, linearised, found, explained, share, surprising, arc.lost)


def drive_of(tracks: Tracks) -> Drive:
    """What drives the interval after each sample [n]; after the last sample of a chain, as at that sample."""
    after = np.minimum(np.arange(len(tracks)) + 1, len(tracks) - 1)
    after = np.where(tracks.chain[after] == tracks.chain, after, np.arange(len(tracks)))
    voltage = tracks.value[:, 3].copy()
    before = np.maximum(np.arange(len(tracks)) - 1, 0)
    alone = tracks.bridged[:, 3] & (tracks.chain[before] == tracks.chain)
    voltage[alone] = (voltage[before] + voltage[after])[alone] / 2  # held, it is that of the sample before
    change = tracks.set_point_m[after] - tracks.set_point_m
    return Drive(tracks.set_point_m, voltage, voltage[after], change)


def first_guess(model: Model, tracks: Tracks) -> Array:
    """States [n, 5] (SI units) as measured; a velocity that was not logged is what the law asks for.

    The memory of a chain is then what is left of its voltage, in the median: velocities have both signs. Without a
    law the velocity is that of the gap's differences.
    """
    gap, logged, current, voltage = tracks.value.T
    guess = np.zeros((len(tracks), STATES))
    guess[:, GAP], guess[:, CURRENT] = gap, current
    if model.gain is None or abs(model.gain[1]) < 1e-9:
        guess[:, VELOCITY] = np.where(np.isfinite(logged), logged, _differences(tracks))
        return _sane(model, guess, guess)
    rest = model.plant.equilibrium(tracks.set_point_m)
    kp, kd, kc, ki = model.gain
    left = voltage - rest.voltage_v - kp * (gap - rest.gap_m) - kc * (current - rest.current_a)
    if abs(ki) > 0:
        middle = np.array([np.median(left[a : a + m]) for a, m in zip(tracks.start, tracks.length, strict=True)])
        guess[:, MEMORY] = (middle / ki)[tracks.chain]
    guess[:, VELOCITY] = np.where(np.isfinite(logged), logged, (left - ki * guess[:, MEMORY]) / kd)
    return _sane(model, guess, guess)


def _shot_across(model: Model, tracks: Tracks, drive: Drive, guess: Array) -> Array:
    """Where messages are missing (at most `MOST_MISSING` in a row), the guess is where the plant goes from before."""
    left = tracks.bridged[:, GAP].copy()
    left[tracks.start] = False
    for _ in range(MOST_MISSING):
        at = np.flatnonzero(left & ~np.append(False, left[:-1])[: len(left)])
        if len(at):
            arc = whole_arc(model, guess[at - 1], drive.part(at - 1))
            guess[at] = _sane(model, arc.state, guess[at])
            left[at] = False
    return guess


def _differences(tracks: Tracks) -> Array:
    gap, chain = tracks.value[:, 0], tracks.chain
    velocity = np.zeros(len(gap))
    forward = np.diff(gap) / tracks.period_s * (np.diff(chain) == 0)
    velocity[:-1] += forward / 2
    velocity[1:] += forward / 2
    return velocity


def _sane(model: Model, x: Array, otherwise: Array) -> Array:
    """Keep a wild estimate where the plant's equations hold; where it is no number, keep the one before."""
    plant, scale = model.plant, model.scale
    x = np.where(np.isfinite(x.sum(axis=1))[:, None], x, otherwise)
    most = 20 * scale
    low = np.array([plant.gap_min_m, -most[1], 0.0, -most[3], -most[4]])
    high = np.array(
        [plant.gap_max_m, most[1], plant.equilibrium(plant.gap_max_m).current_a + most[2], most[3], most[4]]
    )
    return np.clip(x, low, high)


def _by_chain(tracks: Tracks, values: Array) -> Array:
    return np.bincount(tracks.chain, weights=values, minlength=len(tracks.start)).astype(np.float64)
