"""Kalman filter and Rauch-Tung-Striebel smoother over the samples, all chains in lock-step.

The motion between two samples is x' = arc(x0) + motion (x - x0) + noise, linearised about where the last iteration put
the samples (Gauss-Newton on the whole chain: multiple shooting, and the iterated extended smoother of Bell, 1994).
Covariances are updated in forms that keep them symmetric and positive (Joseph). All is over the model's scales.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.recovery.measurement import Measured
from maglev_offline.curate.recovery.model import STATES
from maglev_offline.curate.recovery.shooting import Arc
from maglev_offline.curate.recovery.tracks import Tracks

Array = NDArray[np.float64]


LOST = 1e6
"""Bound on predictions and their covariances, in state scales: a chain that runs away stays finite, and is marked."""


class Smoothed(NamedTuple):
    """States [n, 5] and covariances [n, 5, 5] at the samples, over the model's scale: by the filter and smoothed.

    `nis` [n]: squared innovations over their covariance; `surprise` [n]: minus twice the log-likelihood of each sample.
    """

    filtered: Array
    filtered_covariance: Array
    state: Array
    covariance: Array
    nis: Array
    surprise: Array


def smooth(tracks: Tracks, about: Array, arc: Arc, measured: Measured, prior_std: Array, scale: Array) -> Smoothed:
    """Smooth chains about the states `about` [n, 5] (SI units); the arcs begin at `tracks.inner`."""
    n = len(tracks)
    order = np.argsort(-tracks.length, kind="stable")
    start, length = tracks.start[order], tracks.length[order]
    number = np.zeros(n, dtype=np.int64)
    number[tracks.inner] = np.arange(len(tracks.inner))
    drift = arc.state / scale - (arc.motion @ (about[tracks.inner] / scale)[:, :, None])[:, :, 0]
    x, p = np.zeros((n, STATES)), np.zeros((n, STATES, STATES))
    nis, surprise = np.zeros(n), np.zeros(n)
    mean = _prior_mean(about[start], scale)
    spread = np.broadcast_to(np.diag((prior_std / scale) ** 2), (len(start), STATES, STATES))
    for k in range(int(length.max(initial=0))):
        at = start[: int((length > k).sum())] + k
        if k:
            by = number[at - 1]
            motion = arc.motion[by]
            mean = np.clip((motion @ x[at - 1][:, :, None])[:, :, 0] + drift[by], -LOST, LOST)
            spread = np.clip(motion @ p[at - 1] @ motion.swapaxes(1, 2) + arc.spread[by], -LOST, LOST)
        x[at], p[at], nis[at], surprise[at] = _correct(mean, spread, measured, at)
    state, covariance = x.copy(), p.copy()
    for k in range(int(length.max(initial=0)) - 2, -1, -1):
        at = start[: int((length > k + 1).sum())] + k
        by = number[at]
        state[at], covariance[at] = back(
            x[at], p[at], arc.motion[by], drift[by], arc.spread[by], state[at + 1], covariance[at + 1]
        )
    return Smoothed(x, p, state, covariance, nis, surprise)


def back(
    x: Array, p: Array, motion: Array, drift: Array, spread: Array, later: Array, later_p: Array
) -> tuple[Array, Array]:
    """One step back: filtered x, p at a time and smoothed `later` one arc later, to what is smoothed at the time."""
    forth = motion @ p
    ahead = forth @ motion.swapaxes(1, 2) + spread
    gain = _solve(ahead, forth).swapaxes(1, 2)
    expected = (motion @ x[:, :, None])[:, :, 0] + drift
    rest = np.eye(STATES) - gain @ motion
    covariance = rest @ p @ rest.swapaxes(1, 2) + gain @ (later_p + spread) @ gain.swapaxes(1, 2)
    return x + (gain @ (later - expected)[:, :, None])[:, :, 0], covariance


def _solve(covariance: Array, right: Array) -> Array:
    """covariance^-1 right; a ridge of rounding keeps a chain that runs away from ending all others."""
    size = np.trace(covariance, axis1=1, axis2=2)[:, None, None]
    return np.linalg.solve(covariance + (1e-14 * size + 1e-30) * np.eye(covariance.shape[-1]), right)


def _prior_mean(about: Array, scale: Array) -> Array:
    """At rest where the first sample is; memory as it was guessed, no disturbance."""
    mean = about / scale
    mean[:, [1, 4]] = 0.0
    return mean


def _correct(
    mean: Array, spread: Array, measured: Measured, at: NDArray[np.int64]
) -> tuple[Array, Array, Array, Array]:
    h, noise = measured.matrix[at], measured.noise[at]
    cross = h @ spread
    inside = cross @ h.swapaxes(1, 2) + noise
    gain = _solve(inside, cross).swapaxes(1, 2)
    innovation = measured.value[at] - measured.offset[at] - (h @ mean[:, :, None])[:, :, 0]
    whitened = _solve(inside, innovation[:, :, None])[:, :, 0]
    nis = (innovation * whitened).sum(axis=1)
    rest = np.eye(STATES) - gain @ h
    covariance = rest @ spread @ rest.swapaxes(1, 2) + gain @ noise @ gain.swapaxes(1, 2)
    surprise = nis + np.linalg.slogdet(inside)[1]
    return mean + (gain @ innovation[:, :, None])[:, :, 0], covariance, nis, surprise
