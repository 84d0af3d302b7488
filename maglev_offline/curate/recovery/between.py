"""From smoothed samples to smoothed control periods: the rows that an agent could have made."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.curate.recovery.model import CURRENT, Drive, Model
from maglev_offline.curate.recovery.recover import Recovery
from maglev_offline.curate.recovery.shooting import AT_ONCE, arcs, node_times
from maglev_offline.curate.recovery.smoother import back
from maglev_offline.physics.dynamics import State

Array = NDArray[np.float64]


class Periods(NamedTuple):
    """m control periods, in the order of their intervals and within them; SI units, deviations at the set-point.

    `sample` [m]: row of the samples table at which the interval begins; `substep` [m]; `state` and `next_state` [m, 3]
    with their standard deviations `std` and `next_std`; `voltage_v` [m]: deviation, its mean over the period; `cost`
    [m]: stage cost, summed.
    """

    sample: NDArray[np.int64]
    substep: NDArray[np.int64]
    state: Array
    next_state: Array
    std: Array
    next_std: Array
    voltage_v: Array
    cost: Array


def periods_of(recovery: Recovery) -> Periods:
    """The whole control periods within the intervals of a recovery."""
    inner = recovery.tracks.inner
    parts = [_part(recovery, inner[k : k + AT_ONCE]) for k in range(0, len(inner), AT_ONCE)]
    return joined_periods(parts) if parts else _part(recovery, inner)


def joined_periods(parts: list[Periods]) -> Periods:
    """One after the other."""
    return Periods(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _part(recovery: Recovery, at: NDArray[np.int64]) -> Periods:
    model, drive = recovery.model, recovery.drive.part(at)
    x, p = smoothed_nodes(recovery, at)
    times = node_times(model)
    period_s = model.mdp.plant_steps_per_decision * model.mdp.plant_step_s
    whole = int(np.floor(model.period_s / period_s + 1e-6))
    n = len(at)
    state, following = np.empty((n, whole, 3)), np.empty((n, whole, 3))
    std = np.stack([_std(model, one) for one in p[: whole + 1]], axis=1)
    voltage, cost = np.empty((n, whole)), np.empty((n, whole))
    for k in range(whole):
        state[:, k], following[:, k] = _deviation(model, x[k], drive), _deviation(model, x[k + 1], drive)
        voltage[:, k], cost[:, k] = _along(model, x[k], drive, float(times[k]))
    return Periods(
        sample=np.repeat(recovery.tracks.row[at], whole),
        substep=np.tile(np.arange(whole), n),
        state=state.reshape(-1, 3),
        next_state=following.reshape(-1, 3),
        std=std[:, :-1].reshape(-1, 3),
        next_std=std[:, 1:].reshape(-1, 3),
        voltage_v=voltage.ravel(),
        cost=cost.ravel(),
    )


def smoothed_nodes(recovery: Recovery, at: NDArray[np.int64]) -> tuple[list[Array], list[Array]]:
    """States [n, 5] (SI units) and covariances [n, 5, 5] (over the scale) at each node of the intervals that begin
    `at` samples: predicted from what the filter knew there, then smoothed backward from the next sample."""
    model, found, scale = recovery.model, recovery.found, recovery.model.scale
    about = recovery.about[at]
    x, p = [found.filtered[at]], [found.filtered_covariance[at]]
    motions = []
    for arc in arcs(model, about, recovery.drive.part(at)):
        drift = arc.state / scale - (arc.motion @ (about / scale)[:, :, None])[:, :, 0]
        x.append((arc.motion @ x[-1][:, :, None])[:, :, 0] + drift)
        p.append(arc.motion @ p[-1] @ arc.motion.swapaxes(1, 2) + arc.spread)
        motions.append((arc.motion, drift, arc.spread))
        about = arc.state
    x[-1], p[-1] = found.state[at + 1], found.covariance[at + 1]
    for k in range(len(motions) - 1, 0, -1):
        x[k], p[k] = back(x[k], p[k], *motions[k], x[k + 1], p[k + 1])
    x[0], p[0] = found.state[at], found.covariance[at]
    return [one * scale for one in x], p


def _std(model: Model, covariance: Array) -> Array:
    """Of gap, velocity and current [n, 3]. Where a linearised arc runs away, no less is known than before it all."""
    variance = np.maximum(np.diagonal(covariance, axis1=1, axis2=2)[:, :3], 0.0)
    std: Array = np.minimum(np.sqrt(variance) * model.scale[:3], model.prior_std[:3])
    return std


def _deviation(model: Model, x: Array, drive: Drive) -> Array:
    return process.deviation(model.plant, State(*x.T[: CURRENT + 1]), drive.set_point_m)


def _along(model: Model, x: Array, drive: Drive, begin_s: float) -> tuple[Array, Array]:
    """Mean voltage deviation [n] and stage cost [n] over the control period that begins at the states x [n, 5]."""
    rest_v = model.plant.equilibrium(drive.set_point_m).voltage_v
    dt_s, steps = model.mdp.plant_step_s, model.mdp.plant_steps_per_decision
    mean, seen = np.zeros(len(x)), []
    for k in range(steps):
        seen.append(_deviation(model, x, drive))
        mean += (model.voltage(x, drive, begin_s + k * dt_s)[0] - rest_v) / steps
        x = model.advance(x, drive, begin_s + k * dt_s, dt_s)
    cost = np.zeros(len(x))
    for z in seen:
        cost += process.stage_cost(model.mdp, z, mean)
    return mean, cost
