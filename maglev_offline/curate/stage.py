"""The stage: samples in the workspace -> the curated transitions, with a report of what balance changed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from maglev_offline.control.pid import CascadeGains, PidGains
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.settings import SEVERAL_ROWS, CurateSettings
from maglev_offline.errors import ArtefactError
from maglev_offline.ingest.drawing import PIECE, Drawn, drawn_samples
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress
from maglev_offline.tables import write_parquet
from maglev_offline.workspace import Manifest, Workspace, fingerprint

if TYPE_CHECKING:  # pandas takes half a second to import, and a run that finds all unchanged needs none
    import pandas as pd

    from maglev_offline.curate.usable import Usable

_PID, _CASCADE = PidGains(), CascadeGains()

LAYOUT = 3
"""Counts up where the files or facts of the artefact become others, so that an older one is made anew."""


def curate(
    workspace: Workspace,
    settings: CurateSettings,
    plant: Plant,
    mdp: Mdp,
    *,
    pid: PidGains = _PID,
    cascade: CascadeGains = _CASCADE,
    folders: Sequence[Path] | None = None,
    home: Path | None = None,
    jobs: int = 1,
    progress: Progress = SILENT,
) -> tuple[Path, bool]:
    """Make the `transitions` artefact from samples; return its folder and whether anything was done.

    `pid`, `cascade`: the gains of the laws that the recovery may find in the logs. `folders`: the samples artefacts to
    take; all of the workspace, where it is not given. `home`: another place for the artefact, below the workspace.
    `jobs`: parts of the recovery that go on at once; the bytes are the same.

    The folder holds `transitions.parquet` (the curated set, from the logs for training) and `candidates.parquet` (every
    usable transition of all logs), so that nothing that balance left out is lost; and what was judged before training:
    `diagnostic_rows.parquet`, `diagnostic_cells.parquet` and `residuals.parquet`.

    Raises
    ------
    ArtefactError: there are no samples, or no usable transition in them.
    """
    folders = _samples(workspace, folders)
    inputs = {f"samples/{folder.name}": workspace.input_hash(folder) for folder in folders}
    home = home or workspace.path("transitions")
    mark = fingerprint("curate", inputs, settings, plant, mdp, pid, cascade, layout=LAYOUT)
    if workspace.is_current(home, mark):
        return home, False

    from maglev_offline.curate.constructions.rows import NAMES
    from maglev_offline.curate.usable import usable_rows

    most = max(PIECE, settings.most_samples // _rows_of_a_pair(folders, settings, mdp))
    drawn = drawn_samples(folders, most, settings.seed)
    belief = Belief(settings.recovery, pid, cascade)
    found = usable_rows(drawn.samples, str(workspace.path("samples")), settings, plant, mdp, belief, jobs)
    made = _balanced(found.candidates, drawn.samples["log_id"].unique(), settings, plant, mdp)
    judged = _judged(drawn.samples, made.training, settings, plant, mdp)
    manifest = Manifest(home.relative_to(workspace.root).as_posix(), mark, inputs)
    tables = {"curate": settings, "plant": plant, "mdp": mdp, "pid": pid, "cascade": cascade}
    manifest.settings = {name: table.model_dump(mode="json") for name, table in tables.items()}
    manifest.counts, manifest.left_out = _books(drawn, found, made)
    manifest.facts = made.facts | judged.facts | {"recovery": found.recovery}
    if drawn.left:
        progress.say(_of_the_whole(drawn))
    _tell(progress, found, made.training, settings, manifest.facts["doubts"])
    with workspace.commit(home, manifest) as draft:
        for name, part in {"transitions": made.curated, "candidates": found.candidates, **judged.tables}.items():
            write_parquet(part, draft / f"{name}.parquet", as_text=NAMES)
    return home, True


def _samples(workspace: Workspace, folders: Sequence[Path] | None) -> Sequence[Path]:
    folders = workspace.list("samples") if folders is None else folders
    if not folders:
        raise ArtefactError(
            "there are no samples in the workspace.",
            where=str(workspace.root),
            todo="Run `maglev-offline ingest LOGS...` first.",
        )
    return folders


class _Judged(NamedTuple):
    """What is known before training: facts for the manifest, and the tables behind them by name."""

    facts: dict[str, Any]
    tables: dict[str, pd.DataFrame]


def _judged(samples: pd.DataFrame, training: pd.DataFrame, settings: CurateSettings, plant: Plant, mdp: Mdp) -> _Judged:
    from maglev_offline.curate.diagnostic import diagnosis_of, judge
    from maglev_offline.curate.diagnostic_cells import diagnostic_cells, judged_rows
    from maglev_offline.curate.plausibility import implausible
    from maglev_offline.curate.residual_facts import residual_facts
    from maglev_offline.curate.residual_map import residual_map

    judged = judge(training, plant, mdp, settings.seed)
    residuals = residual_map(samples, plant, mdp, settings.seed)
    facts = {
        "doubts": implausible(samples, plant),
        "construction": settings.construction,
        "diagnostic": diagnosis_of(judged).plain(),
        "residual": residual_facts(residuals, plant),
    }
    rows, cells = judged_rows(judged), diagnostic_cells(judged)
    return _Judged(facts, {"diagnostic_rows": rows, "diagnostic_cells": cells, "residuals": residuals})


class _Balanced(NamedTuple):
    """The rows for training, those of them that balance chose, and what that changed."""

    training: pd.DataFrame
    curated: pd.DataFrame
    facts: dict[str, Any]


def _balanced(
    candidates: pd.DataFrame, logs: Collection[str], settings: CurateSettings, plant: Plant, mdp: Mdp
) -> _Balanced:
    """Mark the split of all `logs` in `candidates`, and choose from the rows for training."""
    from maglev_offline.curate.balance import Candidates, choose
    from maglev_offline.curate.balance.grid import bins_of, cells_of
    from maglev_offline.curate.measures import coverage_facts
    from maglev_offline.curate.measures.weights import importance_weights
    from maglev_offline.curate.split import split_of
    from maglev_offline.curate.transitions import STATE

    candidates["split"] = split_of(candidates["log_id"], settings.validation_share, settings.seed, logs)
    in_training = (candidates["split"] == "train").to_numpy()
    training = candidates if in_training.all() else candidates[in_training].reset_index(drop=True)
    values = training[[*STATE, "voltage_deviation_v"]].to_numpy(dtype=np.float64)
    cell = cells_of(values, bins_of(settings), settings.edge_quantile)
    rows = Candidates(values, training["cost"].to_numpy(dtype=np.float64), cell)
    chosen = choose(rows, settings)
    weight = importance_weights(cell, chosen)
    curated = training.iloc[chosen].reset_index(drop=True).assign(cell=cell[chosen], weight=weight)
    return _Balanced(training, curated, coverage_facts(rows, chosen, weight, settings, plant, mdp))


def _rows_of_a_pair(folders: Sequence[Path], settings: CurateSettings, mdp: Mdp) -> int:
    """How many rows the construction makes of two samples: memory goes by them."""
    if settings.construction not in SEVERAL_ROWS:
        return 1
    periods = [Manifest.read(folder).settings.get("ingest", {}).get("grid_ms", 0.0) for folder in folders]
    return max(1, round(float(max(periods)) / mdp.control_period_ms))


def _of_the_whole(drawn: Drawn) -> str:
    return (
        f"{len(drawn.samples):,} of {drawn.there:,} samples are drawn, minutes of a point at random, since "
        "curate.most_samples says how many fit into memory. The others stay in the workspace."
    )


def _books(drawn: Drawn, found: Usable, made: _Balanced) -> tuple[dict[str, int], dict[str, int]]:
    """Counts, and what was left out by reason: rows are those that were curated and all that was left out.

    Samples that were not drawn make no rows: `samples` are those that were drawn and `samples_not_drawn`.
    """
    counts = {
        "samples": drawn.there,
        "samples_not_drawn": drawn.left,
        "pairs": found.pairs,
        "rows": len(found.reason),
        "candidates": len(found.candidates),
        "transitions": len(made.curated),
    }
    reason = found.reason[found.reason != ""].value_counts().sort_index()
    left_out = {
        **{str(code): int(n) for code, n in reason.items()},
        "held_out_for_validation": len(found.candidates) - len(made.training),
        "not_selected_by_balance": len(made.training) - len(made.curated),
    }
    return counts, left_out


def _tell(
    progress: Progress, found: Usable, training: pd.DataFrame, settings: CurateSettings, doubts: Sequence[str]
) -> None:
    """Warn of what the recipe asks for in vain, to hold out, to leave out or to balance, and of doubts."""
    from maglev_offline.curate.usable import listing

    for rule in found.idle_rules:
        progress.warn(f"no row fits {rule}: its ranges are in SI units, its names those of the logs and points.")
    if settings.validation_share > 0 and len(training) == len(found.candidates):
        progress.warn(
            f"curate.validation_share = {settings.validation_share:g} of {training['log_id'].nunique()} logs is less "
            "than one log: nothing is held out."
        )
    if len(training) <= settings.target_rows:
        unused = (found.reason != "").any()
        lost = f" ({listing(found.reason)} of {len(found.reason)} {found.unit} are not usable)" if unused else ""
        progress.warn(
            f"only {len(training)} usable transitions{lost} for curate.target_rows = {settings.target_rows}: "
            "all are kept, nothing is balanced."
        )
    for doubt in doubts:
        progress.warn(doubt)
