"""Artefacts that another version made: what they do not hold is told in words, with the stage that makes it anew.

The report and the card read many facts of many artefacts. Those that may be absent are asked for with `get`; any other
one that is missing means that a version made the artefact which did not know it yet, or no longer does.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from maglev_offline.errors import ArtefactError
from maglev_offline.workspace import Manifest

STAGE_OF = {
    "samples": "ingest",
    "transitions": "curate",
    "curated": "transfer",
    "arms": "transfer",
    "training": "train",
    "exports": "prefill",
    "shared_content": "ingest",
    "control_page": "control",
}
"""The command that makes an artefact of that kind, where it is not the kind's own name."""

_RUN = ("algorithm", "arm", "seed")
_MOTION = ("t_s", "gap_m", "gap_velocity_m_s", "current_a", "voltage_v")
_CURVES = (
    *(*_RUN, "env_step", "cost", "gap_rmse_m", "worst_error_m", "steady_state_bias_m", "settling_time_s"),
    *("overshoot", "contact_fraction", "saturation_fraction"),
)
_ROW = ("gap_error_m", "gap_velocity_m_s", "current_error_a", "voltage_deviation_v", "cost")
_CELL = ("gap_cell", "velocity_cell", "gap_to_m", "velocity_to_m_s", "rows", "verdict")
_CONTROL = ("controller", "plant_kind", "start_gap_m")
COLUMNS: dict[tuple[str, str], tuple[str, ...]] = {
    ("samples", "quarantine"): ("log_id", "level", "point", "t", "code", "count"),
    ("transitions", "candidates"): _ROW,
    ("transitions", "transitions"): _ROW,
    ("transitions", "diagnostic_rows"): ("gap_cell", "velocity_cell", "advantage", "taught_advantage", "weight"),
    ("transitions", "diagnostic_cells"): (*_CELL, "error_over_advantage_std"),
    ("transitions", "residuals"): (*_CELL, "steps", "kind", "log_id", "point", "unexplained_share"),
    ("control", "metrics"): (*_CONTROL, "cost", "settling_time_s", "overshoot", "steady_state_bias_m"),
    ("control", "responses"): (*_CONTROL, "t_s", "gap_m"),
    ("training", "curves"): _CURVES,
    ("training", "regulation"): (*_RUN, *_MOTION),
    ("transfer", "curves"): _CURVES,
    ("transfer", "metrics"): (*_RUN, "asymptote", "area", "time_to_threshold", "reached"),
}
"""The columns that the pages read, by the kind of artefact and the name of the table."""


class Told(dict[str, Any]):
    """A table of a manifest in which a key that is not there ends in an ArtefactError, however deep it lies."""

    name, folder = "", Path()

    def __missing__(self, key: str) -> Any:
        """Say that another version made the artefact."""
        raise made_by_another(self.name, self.folder, f"no {key!r}")


def as_told(manifest: Manifest, name: str, folder: Path) -> Manifest:
    """The manifest, with facts, settings and counts that tell what they lack; tables are looked at as well.

    Raises
    ------
    ArtefactError: a table of the artefact lacks a column that the pages read.
    """
    kind = name.partition("/")[0]
    for (its, table), columns in COLUMNS.items():
        if its == kind and f"{table}.parquet" in manifest.files:
            there = pq.read_schema(folder / f"{table}.parquet").names
            lacking = [column for column in columns if column not in there]
            if lacking:
                raise made_by_another(name, folder, f"no column {', '.join(lacking)} in {table}.parquet")
    tables = {part: _told(getattr(manifest, part), name, folder) for part in ("facts", "settings", "counts")}
    return replace(manifest, **tables)


def made_by_another(name: str, folder: Path, lacks: str) -> ArtefactError:
    """The error for an artefact that lacks something, with what to do."""
    kind = name.partition("/")[0]
    return ArtefactError(
        f"it was made by another version of maglev-offline: there is {lacks} in it.",
        where=str(folder),
        todo=f"Remove that folder and run `maglev-offline {STAGE_OF.get(kind, kind)}` again.",
    )


def _told(value: Any, name: str, folder: Path) -> Any:
    if isinstance(value, Mapping):
        table = Told({key: _told(part, name, folder) for key, part in value.items()})
        table.name, table.folder = name, folder
        return table
    return [_told(part, name, folder) for part in value] if isinstance(value, list) else value
