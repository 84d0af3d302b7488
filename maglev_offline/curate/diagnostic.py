"""Do the rows teach the truth? The error of the targets they teach, against the advantages an agent has to tell apart.

A row (s, u, c, s', d) teaches the target y = c + d V(s'). The truth, by the simulator, is y* = c_sim + gamma V(s'_sim),
with the voltage held for one decision. V is the value of the reference policy, so A = y* - V(s) is the advantage of u
in s: what is worth knowing, and small beside V. Rows whose error y - y* is large beside the spread of A drown it.

All of it is about the simulator of the recipe's plant: rows that agree with a wrong simulator are fit here.
"""

from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.curate.constructions.rows import NEXT_STATE, STATE
from maglev_offline.curate.reference_value import reference_policy, value
from maglev_offline.curate.resampling import CONFIDENCE, Interval, interval, resamples, units_of
from maglev_offline.curate.simulator import hold
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.streams import stream

Array = NDArray[np.float64]
Verdict = Literal["fit", "doubtful", "harmful"]

MOST_ROWS = 4000
"""So many rows are judged, drawn by the seed, which takes a second."""

FIT_ERROR, HARMFUL_ERROR = 0.75, 3.0
"""Error over the spread of the advantage. With an error that is independent of the advantage and as normal, two rows
put two actions in the right order with probability 1/2 + arctan(1 / error) / pi: at least 80 % of the time up to 0.75,
and at most 60 % from 3 on, where a coin gives 50 %."""

FIT_CORRELATION, HARMFUL_CORRELATION = 0.8, 0.316
"""The correlations that such an error leaves, 1 / sqrt(1 + error^2). An error that goes with the advantage leaves
others, so both numbers are asked for."""


class Targets(NamedTuple):
    """Of n rows, each of shape [n] in units of cost: the target taught, the true one, and V(s)."""

    taught: Array
    true: Array
    value: Array

    @property
    def error(self) -> Array:
        """y - y*."""
        return self.taught - self.true

    @property
    def advantage(self) -> Array:
        """A(s, u) = y* - V(s), under the reference policy; smaller is better, since costs are minimised."""
        return self.true - self.value


def targets_of(table: pd.DataFrame, plant: Plant, mdp: Mdp) -> Targets:
    """Targets that the rows of a table of transitions teach, and the true ones."""
    policy = reference_policy(plant, mdp)
    state, voltage = table[list(STATE)].to_numpy(), table["voltage_deviation_v"].to_numpy()
    held = hold(plant, mdp, state, voltage)
    n = len(table)
    states = np.concatenate([state, held.next_state, table[list(NEXT_STATE)].to_numpy()])
    here, simulated, logged = value(plant, mdp, policy, states).reshape(3, n)
    goes_on = ~(held.touched & mdp.terminate_on_contact)
    return Targets(
        taught=table["cost"].to_numpy() + table["discount"].to_numpy() * logged,
        true=held.cost + mdp.discount * goes_on * simulated,
        value=here,
    )


@dataclass(frozen=True)
class Diagnostic:
    """What the rows teach; a number is None where there is nothing to reckon it from (all rows alike, too few)."""

    verdict: Verdict
    error_over_advantage_std: float | None
    error_over_advantage_std_interval: Interval | None
    correlation_with_advantage: float | None
    correlation_with_advantage_interval: Interval | None
    confidence: float
    rows: int
    resampled: Literal["logs", "stretches"]
    units: int

    def plain(self) -> dict[str, Any]:
        """For a manifest and for scripts."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}


class Judged(NamedTuple):
    """The n rows that are judged, their targets, and what both diagnostics (whole and by cell) resample.

    `weight` [n]: how many rows of the table each stands for, 1 where all are judged.
    `unit` [n]: the log or stretch of each row; `counts` [resamples, units]: how often each comes in each resample.
    """

    rows: pd.DataFrame
    targets: Targets
    resampled: Literal["logs", "stretches"]
    unit: NDArray[np.int64]
    counts: NDArray[np.int64]
    weight: Array


def judge(table: pd.DataFrame, plant: Plant, mdp: Mdp, seed: int) -> Judged:
    """Reckon the targets of the rows of a table of transitions, of at most `MOST_ROWS` that the seed chooses."""
    weight = np.ones(len(table))
    if len(table) > MOST_ROWS:
        share = _shares(table[list(STATE)].to_numpy() / mdp.state_scale)
        # Systematic: one draw, and every row that the steps of one along the summed shares fall into.
        steps = stream(seed, "curate: diagnostic rows").random() + np.arange(MOST_ROWS)
        chosen = np.minimum(np.searchsorted(np.cumsum(share), steps, side="right"), len(table) - 1)
        table, weight = table.iloc[chosen], 1 / share[chosen]
    kind, unit = units_of(table)
    counts = resamples(stream(seed, "curate: diagnostic bootstrap"), int(unit.max()) + 1)
    return Judged(table, targets_of(table, plant, mdp), kind, unit, counts, weight)


def _shares(state: Array) -> Array:
    """Probability [n] of each row to be judged, of states over their scale [n, 3]; they add up to `MOST_ROWS`.

    A quarter alike, the rest by the squared distance from the set-point: costs, advantages and errors grow with it, so
    a few rows in a thousand make most of both numbers, and equal shares leave the verdict to which of them are drawn.
    """
    far = np.sum(state**2, axis=1)
    wanted = 0.25 / len(far) + 0.75 * far / max(float(far.sum()), np.finfo(float).tiny)
    share: Array = np.minimum(wanted * MOST_ROWS / wanted.sum(), 1.0)
    for _ in range(30):  # what is above one goes to the others
        rest = share < 1
        share[rest] *= (MOST_ROWS - np.count_nonzero(~rest)) / share[rest].sum()
        share = np.minimum(share, 1.0)
    return share


def diagnose(table: pd.DataFrame, plant: Plant, mdp: Mdp, seed: int) -> Diagnostic:
    """Judge the rows of a table of transitions; the same table and seed give the same numbers.

    The intervals are of the percentile bootstrap over logs or stretches.
    """
    return diagnosis_of(judge(table, plant, mdp, seed))


def diagnosis_of(judged: Judged) -> Diagnostic:
    """Both numbers of all rows that are judged, and the verdict on them."""
    sums = sums_by_unit(judged.targets, judged.unit, judged.counts.shape[1], judged.weight)
    error, correlation = statistics(sums.sum(axis=0))
    errors, correlations = statistics(judged.counts @ sums)
    between = [interval(values) if len(sums) > 1 else None for values in (errors, correlations)]
    return Diagnostic(
        verdict=verdict_of(*between),
        error_over_advantage_std=number_of(error),
        error_over_advantage_std_interval=between[0],
        correlation_with_advantage=number_of(correlation),
        correlation_with_advantage_interval=between[1],
        confidence=CONFIDENCE,
        rows=len(judged.rows),
        resampled=judged.resampled,
        units=len(sums),
    )


def verdict_of(error: Interval | None, correlation: Interval | None) -> Verdict:
    """`fit` where both intervals lie on the good side, `harmful` where one lies on the bad side, else `doubtful`."""
    if error is None or correlation is None:
        return "doubtful"
    if error[0] >= HARMFUL_ERROR or correlation[1] <= HARMFUL_CORRELATION:
        return "harmful"
    return "fit" if error[1] <= FIT_ERROR and correlation[0] >= FIT_CORRELATION else "doubtful"


def sums_by_unit(found: Targets, unit: NDArray[np.int64], units: int, weight: Array) -> Array:
    """Sums [units, 7] of which every statistic is made, so that a resample costs a product of matrices.

    Columns: rows, error^2, A, A^2, y - V(s), its square, its product with A; both shifted by their means against loss
    of digits, which no statistic sees.
    """
    advantage = found.advantage - found.advantage.mean()
    taught = found.taught - found.value
    taught = taught - taught.mean()
    columns = [np.ones_like(advantage), found.error**2, advantage, advantage**2, taught, taught**2, taught * advantage]
    return np.stack([np.bincount(unit, weights=weight * column, minlength=units) for column in columns], axis=1)


def statistics(sums: Array) -> tuple[Array, Array]:
    """rms(y - y*) / std(A) and corr(y - V(s), A) of sums [..., 7]; NaN where nothing varies."""
    n, squared, a, aa, t, tt, ta = np.moveaxis(sums, -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread_a, spread_t = aa / n - (a / n) ** 2, tt / n - (t / n) ** 2
        # The mean of squares less the square of the mean is never quite 0: a spread of rounding is none.
        spread_a = np.where(spread_a > 1e-12 * aa / n, spread_a, np.nan)
        spread_t = np.where(spread_t > 1e-12 * tt / n, spread_t, np.nan)
        error = np.sqrt(squared / n / spread_a)
        correlation = np.clip((ta / n - a * t / n**2) / np.sqrt(spread_a * spread_t), -1.0, 1.0)
    return error, correlation


def number_of(value: Array) -> float | None:
    """A statistic as a number, None where it has no value."""
    return float(value) if np.isfinite(value) else None
