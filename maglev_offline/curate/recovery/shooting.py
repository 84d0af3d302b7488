"""From each sample to the next through the nonlinear plant, all at once, with the linearised motion beside it."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.recovery.model import GAP, STATES, Drive, Model

Array = NDArray[np.float64]

NEAR_A_STOP = 0.01
"""Share of the travel: where an arc comes so near to a stop, it may have met it, and the plant's equations end."""

AT_ONCE = 4096
"""So many intervals go together, so that what they need stays near the processor."""


class Arc(NamedTuple):
    """Where n states are after a time, how that goes with where they were, and what noise adds, in state scales.

    `state` [n, 5] (SI units), `motion` d(end)/d(begin) and `spread` (covariance of the noise) [n, 5, 5]. `lost` [n]: it
    came so near to a stop that it may have met it, and the noise says that nothing is known of gap, velocity and
    current.
    """

    state: Array
    motion: Array
    spread: Array
    lost: NDArray[np.bool_]


def node_times(model: Model) -> Array:
    """When the control periods within an interval begin and end, and when it ends, seconds, ascending from 0."""
    period_s = model.mdp.plant_steps_per_decision * model.mdp.plant_step_s
    whole = int(np.floor(model.period_s / period_s + 1e-6))
    times: Array = np.arange(whole + 1, dtype=np.float64) * np.float64(period_s)
    if model.period_s - times[-1] > 1e-6 * period_s:
        times = np.append(times, model.period_s)
    times[-1] = model.period_s
    return times


def arcs(model: Model, x: Array, drive: Drive) -> Iterator[Arc]:
    """The arc from each node of an interval to the next, from the states x [n, 5] at its first sample."""
    times = node_times(model)
    for begin_s, end_s in pairwise(times):
        arc = _bounded(_arc(model, x, drive, float(begin_s), float(end_s)))
        yield arc
        x = arc.state


def whole_arc(model: Model, x: Array, drive: Drive) -> Arc:
    """The arc over the whole interval."""
    parts = []
    for start in range(0, len(x), AT_ONCE):
        rows = slice(start, start + AT_ONCE)
        parts.append(_arc(model, x[rows], drive.part(rows), 0.0, model.period_s))
    if not parts:
        return Arc(x, np.zeros((0, STATES, STATES)), np.zeros((0, STATES, STATES)), np.zeros(0, dtype=bool))
    return _bounded(Arc(*(np.concatenate(field) for field in zip(*parts, strict=True))))


def _bounded(arc: Arc) -> Arc:
    """Where the linearised motion overflows, nothing is known of the end."""
    return Arc(arc.state, np.clip(arc.motion, -1e3, 1e3), np.clip(arc.spread, -1e6, 1e6), arc.lost)


def _arc(model: Model, x: Array, drive: Drive, begin_s: float, end_s: float) -> Arc:
    leaves = max(1, int(np.ceil((end_s - begin_s) / model.leaf_s - 1e-9)))
    leaf_s = (end_s - begin_s) / leaves
    motion = np.broadcast_to(np.eye(STATES), (len(x), STATES, STATES))
    spread = np.zeros((len(x), STATES, STATES))
    nearest = _to_a_stop(model, x)
    for k in range(leaves):
        x, leaf, added, near = _leaf(model, x, drive, begin_s + k * leaf_s, leaf_s)
        nearest = np.minimum(nearest, near)
        motion = leaf @ motion
        spread = leaf @ spread @ leaf.swapaxes(1, 2) + added
    lost = nearest < NEAR_A_STOP * (model.plant.gap_max_m - model.plant.gap_min_m)
    spread[:, :3, :3] += lost[:, None, None] * np.diag((model.prior_std / model.scale)[:3] ** 2)
    return Arc(x, motion, spread, lost)


def _to_a_stop(model: Model, x: Array) -> Array:
    """Distance [n] in m of the gap from the nearer stop."""
    return np.minimum(x[:, GAP] - model.plant.gap_min_m, model.plant.gap_max_m - x[:, GAP])


def _leaf(model: Model, x: Array, drive: Drive, begin_s: float, leaf_s: float) -> tuple[Array, Array, Array, Array]:
    """The state after a leaf, exp(J h) with J at its middle, the noise's integral by Simpson's rule, and how near the
    leaf comes to a stop."""
    steps = max(1, round(leaf_s / model.mdp.plant_step_s))
    dt_s, middle, near = leaf_s / steps, x, np.full(len(x), np.inf)
    for k in range(steps):
        if k == steps // 2:
            middle = x
        x = model.advance(x, drive, begin_s + k * dt_s, dt_s)
        near = np.minimum(near, _to_a_stop(model, x))
    scale = model.scale
    j = model.rate_jacobian(middle, drive, begin_s + steps // 2 * dt_s) * (leaf_s * scale / scale[:, None])
    j2 = j @ j
    j3, j4 = j2 @ j, j2 @ j2
    eye = np.eye(STATES)
    whole = eye + j + j2 / 2 + j3 / 6 + j4 / 24
    half = eye + j / 2 + j2 / 8 + j3 / 48 + j4 / 384
    white = leaf_s * model.noise(middle, drive) / scale**2
    added = (whole * white[:, None]) @ whole.swapaxes(1, 2) + 4 * (half * white[:, None]) @ half.swapaxes(1, 2)
    added = (added + white[:, :, None] * eye) / 6
    return x, whole, added, near
