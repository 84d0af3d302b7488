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
from maglev_offline.curate.simulator import hold
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.streams import stream

Array = NDArray[np.float64]
Verdict = Literal["fit", "doubtful", "harmful"]
Interval = tuple[float, float]

MOST_ROWS = 4000
"""So many rows are judged, drawn by the seed, which takes a second. Errors have heavy tails; the intervals say so."""

RESAMPLES = 1000
CONFIDENCE = 0.95

LEAST_LOGS = 8
"""From so many logs on, whole logs are resampled; of fewer, stretches of them, since few logs give no interval."""

BLOCK_S = 10.0
"""Length of a stretch. The slowest loop here, the paper's PID, forgets in 6 s, so stretches are all but independent."""

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


def diagnose(table: pd.DataFrame, plant: Plant, mdp: Mdp, seed: int) -> Diagnostic:
    """Judge the rows of a table of transitions; the same table and seed give the same numbers.

    At most `MOST_ROWS` of them are looked at. The intervals are of the percentile bootstrap over logs or stretches.
    """
    if len(table) > MOST_ROWS:
        chosen = stream(seed, "curate: diagnostic rows").choice(len(table), MOST_ROWS, replace=False)
        table = table.iloc[np.sort(chosen)]
    kind, unit = units_of(table)
    found = targets_of(table, plant, mdp)
    sums = _sums_by_unit(found, unit)
    error, correlation = _statistics(sums.sum(axis=0))
    rng = stream(seed, "curate: diagnostic bootstrap")
    counts = rng.multinomial(len(sums), np.full(len(sums), 1 / len(sums)), RESAMPLES)
    errors, correlations = _statistics(counts @ sums)
    between = [_interval(values) if len(sums) > 1 else None for values in (errors, correlations)]
    return Diagnostic(
        verdict=verdict_of(*between),
        error_over_advantage_std=_number(error),
        error_over_advantage_std_interval=between[0],
        correlation_with_advantage=_number(correlation),
        correlation_with_advantage_interval=between[1],
        confidence=CONFIDENCE,
        rows=len(table),
        resampled=kind,
        units=len(sums),
    )


def units_of(table: pd.DataFrame) -> tuple[Literal["logs", "stretches"], NDArray[np.int64]]:
    """What is resampled, and the unit of each row [n]: its log, or a stretch of `BLOCK_S` of its segment."""
    if table["log_id"].nunique() >= LEAST_LOGS:
        return "logs", pd.factorize(table["log_id"])[0].astype(np.int64)
    segment = table.groupby(["log_id", "point", "segment"], sort=False)
    since_s = (table["t"] - segment["t"].transform("min")).dt.total_seconds().to_numpy()
    keys = pd.DataFrame({"segment": segment.ngroup().to_numpy(), "stretch": np.floor(since_s / BLOCK_S)})
    return "stretches", keys.groupby(["segment", "stretch"], sort=False).ngroup().to_numpy().astype(np.int64)


def verdict_of(error: Interval | None, correlation: Interval | None) -> Verdict:
    """`fit` where both intervals lie on the good side, `harmful` where one lies on the bad side, else `doubtful`."""
    if error is None or correlation is None:
        return "doubtful"
    if error[0] >= HARMFUL_ERROR or correlation[1] <= HARMFUL_CORRELATION:
        return "harmful"
    return "fit" if error[1] <= FIT_ERROR and correlation[0] >= FIT_CORRELATION else "doubtful"


def _sums_by_unit(found: Targets, unit: NDArray[np.int64]) -> Array:
    """Sums [units, 7] of which every statistic is made, so that a resample costs a product of matrices.

    Columns: rows, error^2, A, A^2, y - V(s), its square, its product with A; both shifted by their means against loss
    of digits, which no statistic sees.
    """
    advantage = found.advantage - found.advantage.mean()
    taught = found.taught - found.value
    taught = taught - taught.mean()
    one = np.ones_like(advantage)
    columns = [one, found.error**2, advantage, advantage**2, taught, taught**2, taught * advantage]
    return np.stack([np.bincount(unit, weights=column) for column in columns], axis=1)


def _statistics(sums: Array) -> tuple[Array, Array]:
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


def _interval(values: Array) -> Interval | None:
    if not np.isfinite(values).all():
        return None
    low, high = np.quantile(values, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def _number(value: Array) -> float | None:
    return float(value) if np.isfinite(value) else None
