"""One suspension point: the stretches that its topics have in common, on the grid, cut at contacts."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import contact, ledger, segments
from maglev_offline.ingest.clock import NS_PER_MS
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.resample import Origin, grid_instants, grid_phase, hold, interpolate
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.ingest.topics import CleanTopic
from maglev_offline.ingest.velocity import central_differences
from maglev_offline.logs.mapping import column_of
from maglev_offline.logs.signals import UNIT_OF_SIGNAL
from maglev_offline.physics.dynamics import in_contact
from maglev_offline.physics.parameters import Plant

Scalar = TypeVar("Scalar", bound=np.generic)

LONE_SAMPLE = "lone_sample"
"""Code of a row that is alone in its segment: it is part of no transition."""

_HELD = ("voltage", "set_point")
"""Signals that a digital controller holds between its steps; all others are continuous."""


@dataclass(frozen=True)
class PointSamples:
    """Rows of one point in order of segment and step, n of them.

    `values` holds each float64 column by its name, `origins` the codes of `Origin` for each state column, both of
    shape [n]. `grid_rows` is how many rows were made; those that are not here are in `entries`. `within` and `used`
    tell for each message of each topic whether the topics had it in common, and whether rows came of it.
    """

    point: str
    t_ns: NDArray[np.int64]
    segment: NDArray[np.int32]
    step: NDArray[np.int32]
    values: dict[str, NDArray[np.float64]]
    origins: dict[str, NDArray[np.int8]]
    contact: NDArray[np.bool_]
    grid_rows: int
    entries: list[Quarantined]
    within: dict[str, NDArray[np.bool_]]
    used: dict[str, NDArray[np.bool_]]


def assemble(
    point: str,
    sources: Mapping[str, str],
    topics: Mapping[str, CleanTopic],
    settings: IngestSettings,
    plant: Plant,
) -> PointSamples:
    """Bring the signals of a point together; `sources` names the topic of each signal."""
    raw = _on_grid(sources, topics, settings, plant)
    keep, segment = contact.split(raw.touching, raw.segment)
    lone = np.zeros(len(keep), dtype=np.bool_)
    if keep.any():
        lone = keep & (np.bincount(segment[keep], minlength=int(segment.max()) + 1)[segment] == 1)
    entries = [
        ledger.rows(point, sources["gap"], contact.CONTACT, raw.t_ns[~keep]),
        ledger.rows(point, sources["gap"], LONE_SAMPLE, raw.t_ns[lone], "the only row of its segment"),
    ]
    stay = keep & ~lone
    segment = segment[stay]
    values = {name: column[stay] for name, column in raw.values.items()}
    origins = {name: column[stay] for name, column in raw.origins.items()}
    if "gap_velocity_m_s" not in values:
        values["gap_velocity_m_s"] = central_differences(values["gap_m"], segment, settings.grid_ms / 1e3)
        origins["gap_velocity_m_s"] = np.full(len(segment), Origin.RECONSTRUCTED, dtype=np.int8)
    if "set_point_m" not in values:
        values["set_point_m"] = np.full(len(segment), plant.set_point_m)
    number, step = _renumber(segment)
    return PointSamples(
        point=point,
        t_ns=raw.t_ns[stay],
        segment=number,
        step=step,
        values=values,
        origins=origins,
        contact=raw.touching[stay],
        grid_rows=len(raw.t_ns),
        entries=entries,
        within=raw.within,
        used=raw.used,
    )


class _Rows(NamedTuple):
    """All grid rows of a point before any is put aside; `segment` numbers the stretches in common."""

    t_ns: NDArray[np.int64]
    segment: NDArray[np.int64]
    values: dict[str, NDArray[np.float64]]
    origins: dict[str, NDArray[np.int8]]
    touching: NDArray[np.bool_]
    within: dict[str, NDArray[np.bool_]]
    used: dict[str, NDArray[np.bool_]]


def _on_grid(
    sources: Mapping[str, str], topics: Mapping[str, CleanTopic], settings: IngestSettings, plant: Plant
) -> _Rows:
    period_ns = round(settings.grid_ms * NS_PER_MS)
    tolerance_ns = round(settings.hold_tolerance_share * period_ns)
    names = tuple(dict.fromkeys(sources.values()))
    common = segments.in_common([topics[name].stretches for name in names])
    within = {name: np.zeros(len(topics[name].t_ns), dtype=np.bool_) for name in names}
    used = {name: np.zeros(len(topics[name].t_ns), dtype=np.bool_) for name in names}

    grids: list[NDArray[np.int64]] = []
    values: dict[str, list[NDArray[np.float64]]] = {name: [] for name in sources}
    origins: dict[str, list[NDArray[np.int8]]] = {name: [] for name in sources}
    touching: list[NDArray[np.bool_]] = []
    for k in range(len(common.start_ns)):
        spans = {name: _span(topics[name], int(stretch)) for name, stretch in zip(names, common.parts[k], strict=True)}
        phase_ns = grid_phase(topics[sources["gap"]].t_ns[spans[sources["gap"]]], period_ns)
        grid = grid_instants(int(common.start_ns[k]), int(common.end_ns[k]), period_ns, phase_ns)
        for name in names:
            bracket = _bracket(topics[name].t_ns, spans[name], int(common.start_ns[k]), int(common.end_ns[k]))
            within[name][bracket] = True
            used[name][bracket] |= len(grid) > 0
        if len(grid) == 0:
            continue
        grids.append(grid)
        for signal, source in sources.items():
            t_ns, logged = topics[source].t_ns[spans[source]], topics[source].values[signal][spans[source]]
            column, origin = (
                hold(t_ns, logged, grid, tolerance_ns) if signal in _HELD else interpolate(t_ns, logged, grid)
            )
            values[signal].append(column)
            origins[signal].append(origin)
            if signal == "gap":
                at_stop = _at_stop(plant, column, settings)
                touching.append(contact.touched_rows(grid, at_stop, t_ns, _at_stop(plant, logged, settings)))
    return _Rows(
        t_ns=_joined(grids, np.int64),
        segment=np.repeat(np.arange(len(grids)), [len(grid) for grid in grids]),
        values={column_of(name): _joined(parts, np.float64) for name, parts in values.items()},
        origins={column_of(n): _joined(parts, np.int8) for n, parts in origins.items() if n in UNIT_OF_SIGNAL},
        touching=_joined(touching, np.bool_),
        within=within,
        used=used,
    )


def _at_stop(plant: Plant, gap_m: NDArray[np.float64], settings: IngestSettings) -> NDArray[np.bool_]:
    touching: NDArray[np.bool_] = in_contact(plant, gap_m, settings.contact_tolerance_m)
    return touching


def _span(topic: CleanTopic, stretch: int) -> slice:
    return slice(int(topic.stretches.first[stretch]), int(topic.stretches.stop[stretch]))


def _bracket(t_ns: NDArray[np.int64], span: slice, start_ns: int, end_ns: int) -> slice:
    """Messages of a stretch from the latest at or before `start_ns` to the earliest at or after `end_ns`."""
    t = t_ns[span]
    first = max(int(np.searchsorted(t, start_ns, side="right")) - 1, 0)
    last = min(int(np.searchsorted(t, end_ns, side="left")), len(t) - 1)
    return slice(span.start + first, span.start + last + 1)


def _joined(parts: list[NDArray[Scalar]], kind: type[Scalar]) -> NDArray[Scalar]:
    return np.concatenate(parts) if parts else np.empty(0, dtype=kind)


def _renumber(segment: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Number the segments from 0 without gaps, and the rows of each from 0."""
    if len(segment) == 0:
        return np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32)
    starts = np.concatenate([[True], np.diff(segment) != 0])
    number = np.cumsum(starts) - 1
    return number.astype(np.int32), (np.arange(len(segment)) - np.flatnonzero(starts)[number]).astype(np.int32)
