"""One suspension point: the stretches that its topics have in common, on the grid, cut at contacts."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import contact, context, ledger, segments
from maglev_offline.ingest.grid import ON_GRID_NS, instants, phases
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.placing import Bounds
from maglev_offline.ingest.resample import Origin
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.ingest.source import Source
from maglev_offline.ingest.topics import CleanTopic
from maglev_offline.ingest.velocity import central_differences
from maglev_offline.logs.mapping import column_of
from maglev_offline.logs.signals import UNIT_OF_SIGNAL
from maglev_offline.physics.dynamics import in_contact
from maglev_offline.physics.parameters import Plant

LONE_SAMPLE = "lone_sample"
"""Code of a row that is alone in its segment: it is part of no transition."""

BETWEEN_MESSAGES = "between_messages"
"""Code of a row whose state was not measured, where the recipe leaves such rows out."""


@dataclass(frozen=True)
class PointSamples:
    """Rows of one point in order of segment and step, n of them.

    `values` holds each float64 column by its name, `origins` the codes of `Origin` for each that comes from the log,
    both of shape [n]. `grid_rows` is how many rows were made; those that are not here are in `entries`. `within` and
    `used` tell for each message of each topic whether the topics had it in common, and whether rows came of it.
    `faster` and `slower` name the signals whose source is faster or slower than the grid.
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
    faster: tuple[str, ...] = ()
    slower: tuple[str, ...] = ()


def assemble(
    point: str,
    sources: Mapping[str, str],
    topics: Mapping[str, CleanTopic],
    settings: IngestSettings,
    plant: Plant,
) -> PointSamples:
    """Bring the signals of a point together; `sources` names the topic of each signal."""
    raw = _on_grid(sources, topics, settings, plant)
    grid_rows = len(raw.t_ns)
    entries: list[Quarantined] = []
    if settings.resample.slower == "leave_out":
        between = _interpolated(raw)
        entries.append(ledger.rows(point, sources["gap"], BETWEEN_MESSAGES, raw.t_ns[between]))
        raw = _leave_out(raw, between) if between.any() else raw
    keep, segment = contact.split(raw.touching, raw.segment)
    lone = _alone(keep, segment)
    entries += [
        ledger.rows(point, sources["gap"], contact.CONTACT, raw.t_ns[~keep]),
        ledger.rows(point, sources["gap"], LONE_SAMPLE, raw.t_ns[lone], "the only row of its segment"),
    ]
    # Taking all of them by a mask would be a copy of the point for nothing.
    stay = slice(None) if keep.all() and not lone.any() else keep & ~lone
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
        grid_rows=grid_rows,
        entries=entries,
        within=raw.within,
        used=raw.used,
        faster=raw.faster,
        slower=raw.slower,
    )


def _alone(keep: NDArray[np.bool_], segment: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Rows that are kept and are the only ones of their segment, shape [n]; segments ascend."""
    alone = np.zeros(len(keep), dtype=np.bool_)
    kept = segment[keep]
    changes = np.concatenate([[True], kept[1:] != kept[:-1], [True]])
    alone[keep] = changes[:-1] & changes[1:] if len(kept) else False
    return alone


class _Rows(NamedTuple):
    """All grid rows of a point before any is put aside; `segment` numbers the stretches in common."""

    t_ns: NDArray[np.int64]
    segment: NDArray[np.int64]
    values: dict[str, NDArray[np.float64]]
    origins: dict[str, NDArray[np.int8]]
    touching: NDArray[np.bool_]
    within: dict[str, NDArray[np.bool_]]
    used: dict[str, NDArray[np.bool_]]
    faster: tuple[str, ...]
    slower: tuple[str, ...]


def _on_grid(
    sources: Mapping[str, str], topics: Mapping[str, CleanTopic], settings: IngestSettings, plant: Plant
) -> _Rows:
    gap_topic = topics[sources["gap"]]
    # The gap's topic comes first. Context follows the stretches of the state: a slow speed is no hole in the gap.
    of_state = tuple(dict.fromkeys([gap_topic.topic, *(t for s, t in sources.items() if s in UNIT_OF_SIGNAL)]))
    common = segments.in_common([topics[name].stretches for name in of_state])
    stretches = gap_topic.stretches
    phase = phases(gap_topic.t_ns, stretches.first, stretches.stop, settings.grid_ns)
    grid = instants(common.start_ns, common.end_ns, phase[common.parts[:, 0]], settings.grid_ns)

    made: dict[str, Source] = {}
    within: dict[str, NDArray[np.bool_]] = {}
    used: dict[str, NDArray[np.bool_]] = {}
    for name in dict.fromkeys([*of_state, *sources.values()]):
        if name in of_state:
            bounds = _own(topics[name].stretches, common.parts[:, of_state.index(name)])
        else:
            bounds = context.follow(stretches, common, topics[name].stretches)
        made[name] = Source(topics[name], grid, bounds, settings, context_only=name not in of_state)
        within[name], used[name] = made[name].drawn_on(common, [s for s, t in sources.items() if t == name])

    columns = {signal: made[name].column(signal) for signal, name in sources.items()}
    return _Rows(
        t_ns=grid.t_ns,
        segment=np.repeat(np.arange(len(common.start_ns)), grid.rows),
        values={column_of(signal): values for signal, (values, _) in columns.items()},
        origins={column_of(signal): origins for signal, (_, origins) in columns.items()},
        touching=_touching(made[gap_topic.topic], columns["gap"][0], plant, settings),
        within=within,
        used=used,
        faster=tuple(signal for signal, name in sources.items() if made[name].faster),
        slower=tuple(signal for signal, name in sources.items() if made[name].slower),
    )


def _own(stretches: segments.Stretches, parts: NDArray[np.int64]) -> Bounds:
    return Bounds(stretches.first[parts], stretches.stop[parts], stretches.epoch[parts])


def _touching(gap: Source, on_grid: NDArray[np.float64], plant: Plant, settings: IngestSettings) -> NDArray[np.bool_]:
    """Rows in contact with a stop, by the gap of the row or of a message since the row before; shape [rows]."""
    rows = in_contact(plant, on_grid, settings.contact_tolerance_m)
    messages = in_contact(plant, gap.topic.values["gap"], settings.contact_tolerance_m)
    if len(rows) == 0 or not messages.any():
        return np.asarray(rows, dtype=np.bool_)
    # A message on the instant is the row's own, even where it comes a microsecond after.
    through = gap.place.latest(ON_GRID_NS)[0] + 1
    return contact.touched_rows(rows, messages, through, gap.grid.begin[:-1][gap.grid.rows > 0])


def _interpolated(raw: _Rows) -> NDArray[np.bool_]:
    """Rows in which a state signal lies between two messages of a source that is slower than the grid."""
    found = np.zeros(len(raw.t_ns), dtype=np.bool_)
    for signal in raw.slower:
        if signal in UNIT_OF_SIGNAL:
            found |= np.isin(raw.origins[column_of(signal)], [Origin.INTERPOLATED, Origin.BRIDGED])
    return found


def _leave_out(raw: _Rows, which: NDArray[np.bool_]) -> _Rows:
    """Without some rows; what follows one of them is another segment."""
    rest = ~which
    begins = np.concatenate([[True], which[:-1] | (raw.segment[1:] != raw.segment[:-1])])
    return raw._replace(
        t_ns=raw.t_ns[rest],
        segment=np.cumsum(begins)[rest],
        values={name: column[rest] for name, column in raw.values.items()},
        origins={name: column[rest] for name, column in raw.origins.items()},
        touching=raw.touching[rest],
    )


def _renumber(segment: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Number the segments from 0 without gaps, and the rows of each from 0."""
    if len(segment) == 0:
        return np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32)
    begins = np.flatnonzero(np.concatenate([[True], segment[1:] != segment[:-1]])).astype(np.int32)
    rows = np.diff(begins, append=np.int32(len(segment)))
    number = np.repeat(np.arange(len(begins), dtype=np.int32), rows)
    return number, np.arange(len(segment), dtype=np.int32) - np.repeat(begins, rows)
