"""The residual between logs and simulator by region, log and point: what the simulator does not explain.

Over the time of some samples, r = (logged end) - (simulated end) and d = (logged end) - (beginning), both over
`mdp.state_scale`. With means over the windows of one part of the logs, and sums over gap, velocity and current:

    share not explained = sum mean(r^2) / sum mean(d^2)      1 - R^2 against the guess that nothing changes
    share of offset     = sum mean(r)^2 / sum mean(r^2)      what is the same in every window, as a wrong plant makes it

What is no offset is scatter: noise of the sensors and random force, which an unstable plant lets grow, and a voltage
that was not on the line between two samples.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse import csr_array

from maglev_offline.curate.cells import CELLS, cells_along, ends, inner_edges, state_cells
from maglev_offline.curate.diagnostic_cells import TOO_FEW
from maglev_offline.curate.resampling import (
    LEAST_ROWS,
    LEAST_UNITS,
    interval_of_part,
    resamples,
    rows_and_units,
    stretches_of,
    units_of,
)
from maglev_offline.curate.residual import Windows, predicted, recording_of, windows_of
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.streams import stream

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STEPS_AHEAD = (1, 2, 5)
"""Over so many samples the simulator runs."""

MOST_NOT_EXPLAINED = 0.5
"""A part is `unexplained` where the whole interval of its share not explained lies above: less than half of the change
that was logged is the simulator's. At 1 the simulator is no better than the guess that nothing changes."""

LEAST_OFFSET = 0.5
"""From here on, with the whole interval, most of what is not explained is an offset: look at the plant first."""

SIGNALS = ("gap", "velocity", "current")
_CELLS = ("gap_cell", "velocity_cell", "voltage_cell")
_PLACES = ("gap_from_m", "gap_to_m", "velocity_from_m_s", "velocity_to_m_s", "voltage_from_v", "voltage_to_v")


class _Part(NamedTuple):
    """A way to cut the windows: the part of each window [n], what each part is (columns), and what is resampled."""

    kind: str
    of: Ints
    names: Mapping[str, NDArray[Any]]
    unit: Ints


_APART: dict[str, Any] = {"log_id": "", "point": "", **dict.fromkeys(_CELLS, np.int32(-1))}
_APART |= dict.fromkeys(_PLACES, np.nan)
"""The columns that say what a part is, and what stands where one does not apply."""


def residual_map(samples: pd.DataFrame, plant: Plant, mdp: Mdp, seed: int) -> pd.DataFrame:
    """The residual of all logs, by log, point, cell of gap error and velocity, and cell of voltage, for each length.

    Columns: `steps`, `duration_s`, `kind` (all, log, point, region, voltage), `log_id`, `point`, `gap_cell`,
    `velocity_cell`, `voltage_cell` (-1 where they do not apply) and where those begin and end, `rows` (windows),
    `units`; for gap, velocity and current the signed mean, the rms, and the rms of the change, over the state scale
    (`gap_mean`, `gap_rms`, `gap_change`, ...); `unexplained_share` and `offset_share`, each with `..._low` and
    `..._high`; `verdict` (explained, open, unexplained, or too_few), and `offset` (unexplained, and mostly an offset).
    Parts without a window are left out. A length of which there is no window has no rows.
    """
    recording = recording_of(samples)
    found: list[dict[str, NDArray[Any]]] = []
    for steps in STEPS_AHEAD:
        windows = windows_of(recording, steps, seed)
        if len(windows):
            found += _of_length(windows, steps, plant, mdp, seed)
    if not found:
        return pd.DataFrame(columns=["steps", "kind"])
    table = pd.DataFrame({name: np.concatenate([one[name] for one in found]) for name in found[0]})
    return table[table["rows"] > 0].reset_index(drop=True)


def _of_length(windows: Windows, steps: int, plant: Plant, mdp: Mdp, seed: int) -> list[dict[str, NDArray[Any]]]:
    """The columns of each way to cut."""
    residual = (windows.later - predicted(windows, plant, mdp)) / mdp.state_scale
    change = (windows.later - windows.state) / mdp.state_scale
    terms = np.concatenate([np.ones((len(windows), 1)), residual, residual**2, change**2], axis=1)
    duration_s = float(np.median(windows.duration_s.sum(axis=1)))
    rng = stream(seed, f"curate: residual bootstrap of {steps}")
    found = []
    for part in _parts(windows, plant):
        count = len(next(iter(part.names.values())))
        place = {
            "steps": np.full(count, steps, dtype=np.int32),
            "duration_s": np.full(count, duration_s),
            "kind": np.full(count, part.kind, dtype=object),
        }
        place |= {name: part.names.get(name, np.full(count, absent)) for name, absent in _APART.items()}
        found.append({**place, **_judged(part, count, terms, rng)})
    return found


def _parts(windows: Windows, plant: Plant) -> list[_Part]:
    """All ways to cut. A log is judged by its own stretches; a region by logs, where there are enough of them."""
    place = windows.place
    resampled, unit = units_of(place)
    stretch = unit if resampled == "stretches" else stretches_of(place)
    region = state_cells(windows.state[:, 0] - windows.set_point_m, windows.state[:, 1])
    voltage = windows.voltage_v[:, 0] - np.asarray(plant.equilibrium(windows.set_point_m).voltage_v)
    voltage_edges = inner_edges(voltage)
    volts = dict(zip(("voltage_from_v", "voltage_to_v"), ends(voltage_edges), strict=True))
    log, logs = pd.factorize(place["log_id"])
    points = place[["log_id", "point"]].drop_duplicates()
    point = place.groupby(["log_id", "point"], sort=False).ngroup().to_numpy().astype(np.int64)
    regions = {str(name): column.to_numpy() for name, column in region.places.items()}
    return [
        _Part("all", np.zeros(len(windows), dtype=np.int64), {"log_id": np.array([""], dtype=object)}, unit),
        _Part("log", log.astype(np.int64), {"log_id": np.asarray(logs, dtype=object)}, stretch),
        _Part("point", point, {name: points[name].to_numpy(dtype=object) for name in ("log_id", "point")}, stretch),
        _Part("region", region.number, regions, unit),
        _Part(
            "voltage",
            cells_along(voltage, voltage_edges),
            {"voltage_cell": np.arange(CELLS, dtype=np.int32), **volts},
            unit,
        ),
    ]


def _judged(part: _Part, parts: int, terms: Array, rng: np.random.Generator) -> dict[str, NDArray[Any]]:
    """The statistics of each part of one kind, with intervals and verdicts; `terms` [n, 10] are summed by part."""
    by_part = [np.bincount(part.of, weights=term, minlength=parts) for term in terms.T]
    total = np.stack(by_part, axis=1).astype(np.float64)
    rows, of_units = rows_and_units(part.of, part.unit, parts)
    found: dict[str, NDArray[Any]] = {"rows": rows, "units": of_units}
    by_signal = dict(zip(("mean", "rms", "change"), _moments(total), strict=True))
    for number, name in enumerate(SIGNALS):
        found |= {f"{name}_{what}": values[:, number] for what, values in by_signal.items()}
    enough = (rows >= LEAST_ROWS) & (of_units >= LEAST_UNITS)
    drawn = _resampled(part, enough, terms, rng)
    for name, share in (("unexplained_share", _not_explained), ("offset_share", _offset)):
        span_ends = np.full((2, parts), np.nan)
        spans = [interval_of_part(values) for values in share(drawn).T]
        span_ends[:, enough] = np.array([(np.nan, np.nan) if span is None else span for span in spans]).reshape(-1, 2).T
        found[name], found[f"{name}_low"], found[f"{name}_high"] = share(total), *span_ends
    found["verdict"] = _verdicts(found["unexplained_share_low"], found["unexplained_share_high"], enough)
    found["offset"] = (found["verdict"] == "unexplained") & (found["offset_share_low"] > LEAST_OFFSET)
    return found


def _resampled(part: _Part, enough: NDArray[np.bool_], terms: Array, rng: np.random.Generator) -> Array:
    """Sums [resamples, parts, 10] of those parts that have enough rows.

    Of thousands of parts and of units, all but a few pairs have nothing in common, so what they hold is kept sparse.
    """
    units, mine = int(part.unit.max()) + 1, enough[part.of]
    counts = resamples(rng, units).astype(np.float64) if enough.any() else np.zeros((0, units))
    place = (np.cumsum(enough) - 1).astype(np.int64)
    at = (part.unit[mine], place[part.of[mine]])
    shape = (units, int(np.count_nonzero(enough)))
    return np.stack([np.asarray(counts @ csr_array((term[mine], at), shape=shape)) for term in terms.T], axis=-1)


def _verdicts(low: Array, high: Array, enough: NDArray[np.bool_]) -> NDArray[Any]:
    verdict = np.where(low > MOST_NOT_EXPLAINED, "unexplained", "open")
    verdict = np.where(high <= MOST_NOT_EXPLAINED, "explained", verdict)
    return np.where(enough, verdict, TOO_FEW).astype(object)


def _moments(sums: Array) -> tuple[Array, Array, Array]:
    """Mean and rms of the residual, and rms of the change, each [..., 3], of sums [..., 10]; NaN without rows."""
    with np.errstate(invalid="ignore", divide="ignore"):
        means = sums[..., 1:] / sums[..., :1]
    return means[..., :3], np.sqrt(means[..., 3:6]), np.sqrt(means[..., 6:])


def _not_explained(sums: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        share: Array = sums[..., 4:7].sum(axis=-1) / sums[..., 7:].sum(axis=-1)
    return np.where(np.isfinite(share), share, np.nan)


def _offset(sums: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        share: Array = (sums[..., 1:4] ** 2).sum(axis=-1) / (sums[..., :1] * sums[..., 4:7]).sum(axis=-1)
    return np.where(np.isfinite(share), share, np.nan)
