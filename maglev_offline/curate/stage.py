"""The stage: samples in the workspace -> the curated transitions, with a report of what balance changed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from maglev_offline.control.pid import CascadeGains, PidGains
from maglev_offline.curate.balance import (
    balanced_choice,
    cells_of,
    effective_sample_size,
    importance_weights,
    occupancy,
)
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.words import recovery_words
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.errors import ArtefactError
from maglev_offline.ingest.store import load_samples
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress
from maglev_offline.streams import stream
from maglev_offline.tables import write_parquet
from maglev_offline.workspace import Manifest, Workspace, fingerprint

if TYPE_CHECKING:  # pandas takes half a second to import, and a run that finds all unchanged needs none
    import pandas as pd

    from maglev_offline.curate.pairs import Pairs

_PID, _CASCADE = PidGains(), CascadeGains()


def curate(
    workspace: Workspace,
    settings: CurateSettings,
    plant: Plant,
    mdp: Mdp,
    *,
    pid: PidGains = _PID,
    cascade: CascadeGains = _CASCADE,
    folders: Sequence[Path] | None = None,
    progress: Progress = SILENT,
) -> tuple[Path, bool]:
    """Make the `transitions` artefact from samples; return its folder and whether anything was done.

    `folders`: the samples artefacts to take; all of the workspace, where it is not given. `pid`, `cascade`: the gains
    of the laws that the recovery may find in the logs.

    The folder holds `transitions.parquet` (the curated set, from the logs for training) and `candidates.parquet` (every
    usable transition of all logs), so that nothing that balance left out is lost.

    Raises
    ------
    ArtefactError: there are no samples, or no usable transition in them.
    """
    folders = workspace.list("samples") if folders is None else folders
    if not folders:
        raise ArtefactError(
            "there are no samples in the workspace.",
            where=str(workspace.root),
            todo="Run `maglev-offline ingest LOGS...` first.",
        )
    inputs = {f"samples/{folder.name}": workspace.input_hash(folder) for folder in folders}
    home = workspace.path("transitions")
    mark = fingerprint("curate", inputs, settings, plant, mdp, pid, cascade)
    if workspace.is_current(home, mark):
        return home, False

    from maglev_offline.curate.diagnostic import diagnose
    from maglev_offline.curate.plausibility import implausible

    samples = load_samples(folders)
    found = _usable(samples, workspace, settings, plant, mdp, Belief(settings.recovery, pid, cascade))
    candidates, reason = found.candidates, found.reason
    training, curated = _balanced(candidates, settings)
    _tell(progress, found, training, settings)
    doubts = implausible(samples, plant)
    for doubt in doubts:
        progress.warn(doubt)

    manifest = Manifest("transitions", mark, inputs)
    tables = {"curate": settings, "plant": plant, "mdp": mdp, "pid": pid, "cascade": cascade}
    manifest.settings = {name: table.model_dump(mode="json") for name, table in tables.items()}
    manifest.counts = {
        "pairs": found.pairs,
        "rows": len(reason),
        "candidates": len(candidates),
        "transitions": len(curated),
    }
    manifest.left_out = {
        **{str(code): int(n) for code, n in reason[reason != ""].value_counts().sort_index().items()},
        "held_out_for_validation": len(candidates) - len(training),
        "not_selected_by_balance": len(training) - len(curated),
    }
    manifest.facts = {
        **coverage_facts(training, curated, settings),
        "doubts": doubts,
        "construction": settings.construction,
        "diagnostic": diagnose(training, plant, mdp, settings.seed).plain(),
        "recovery": found.recovery,
    }
    with workspace.commit(home, manifest) as draft:
        for name, part in (("transitions", curated), ("candidates", candidates)):
            write_parquet(part, draft / f"{name}.parquet")
    return home, True


class _Usable(NamedTuple):
    """The usable transitions, of how many pairs of samples, why a row that was made is none (empty: it is one), and
    what can be known of states between samples (`recovery.verdict`)."""

    candidates: pd.DataFrame
    pairs: int
    reason: pd.Series
    recovery: dict[str, Any]

    @property
    def unit(self) -> str:
        """What was made: a row for each pair, or several."""
        return "pairs" if len(self.reason) == self.pairs else "rows"


def _usable(
    samples: pd.DataFrame, workspace: Workspace, settings: CurateSettings, plant: Plant, mdp: Mdp, belief: Belief
) -> _Usable:
    from maglev_offline.curate.pairs import pairs_of
    from maglev_offline.curate.transitions import unusable

    where = str(workspace.path("samples"))
    pairs = pairs_of(samples, plant)
    if not len(pairs):
        raise ArtefactError(
            "no two samples follow each other in a segment, so there is no transition.",
            where=where,
            todo="Look at [ingest] longest_bridge_ms against the period of the messages.",
        )
    table, recovery = _made(pairs, settings, plant, mdp, belief)
    reason = unusable(table, mdp)
    if settings.share_kept is not None:
        _leave_out_inconsistent(table, reason, settings.share_kept, plant, mdp)
    found = _Usable(table[reason == ""].reset_index(drop=True), len(pairs), reason, recovery)
    if found.candidates.empty:
        known = f"; {recovery_words(recovery)}" if settings.construction == "reconstructed" else ""
        raise ArtefactError(
            f"no usable transition in {len(reason)} {found.unit} of samples ({_listing(reason)}{known}).",
            where=where,
            todo=_todo(reason),
        )
    return found


def _made(
    pairs: Pairs, settings: CurateSettings, plant: Plant, mdp: Mdp, belief: Belief
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """The rows of the construction, and the facts of the recovery: of all samples where the rows come from it."""
    from maglev_offline.curate.constructions import CONSTRUCTIONS
    from maglev_offline.curate.constructions.reconstructed import reconstructed_rows
    from maglev_offline.curate.recovery.logs import recover_logs
    from maglev_offline.curate.recovery.verdict import pilot, recovery_facts

    if settings.construction == "reconstructed":
        recovered = recover_logs(pairs.samples, plant, mdp, belief)
        return reconstructed_rows(pairs, plant, mdp, recovered), recovery_facts(pairs.samples, recovered.logs)
    found = pilot(pairs.samples, plant, mdp, belief)
    return CONSTRUCTIONS[settings.construction](pairs, plant, mdp), recovery_facts(pairs.samples, found)


def _leave_out_inconsistent(table: pd.DataFrame, reason: pd.Series, fraction: float, plant: Plant, mdp: Mdp) -> None:
    """Give a reason to those usable rows that agree least with the simulator."""
    from maglev_offline.curate.consistency import inconsistent, one_step_residual

    usable = np.flatnonzero(reason == "")
    marked = inconsistent(one_step_residual(table.iloc[usable], plant, mdp), fraction)
    reason.iloc[usable[marked]] = "inconsistent_with_simulator"


def _todo(reason: pd.Series) -> str:
    if (reason == "not_explained_by_plant").mean() > 0.5:
        return (
            "Is [plant] that of the logs (`maglev-offline identify`), and [curate.recovery] law and noise right? "
            "Otherwise take another [curate] construction."
        )
    if (reason == "shorter_than_a_decision").any():
        return (
            "The samples lie closer than mdp.control_period_ms: take another [curate] construction, "
            "or a larger ingest.grid_ms."
        )
    return "Check the units in [signals], and mdp.voltage_limit_v against the logged voltage."


def _balanced(candidates: pd.DataFrame, settings: CurateSettings) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Mark the split in `candidates`; return the rows for training with their cells, and the choice of them."""
    candidates["split"] = _split(candidates["log_id"], settings)
    training = candidates[candidates["split"] == "train"].reset_index(drop=True)
    training["cell"] = _cells(training, settings)
    cell = training["cell"].to_numpy()
    chosen = balanced_choice(cell, settings.target_rows, stream(settings.seed, "curate: balance"))
    curated = training.iloc[chosen].reset_index(drop=True)
    curated["weight"] = importance_weights(cell, chosen)
    return training, curated


def _tell(progress: Progress, found: _Usable, training: pd.DataFrame, settings: CurateSettings) -> None:
    """Warn where nothing is held out although it was asked for, and where there is nothing to balance."""
    if settings.validation_share > 0 and len(training) == len(found.candidates):
        progress.warn(
            f"curate.validation_share = {settings.validation_share:g} of {training['log_id'].nunique()} logs is less "
            "than one log: nothing is held out."
        )
    if len(training) <= settings.target_rows:
        unused = (found.reason != "").any()
        lost = f" ({_listing(found.reason)} of {len(found.reason)} {found.unit} are not usable)" if unused else ""
        progress.warn(
            f"only {len(training)} usable transitions{lost} for curate.target_rows = {settings.target_rows}: "
            "all are kept, nothing is balanced."
        )


def _listing(reason: pd.Series) -> str:
    return ", ".join(f"{code}: {n}" for code, n in reason[reason != ""].value_counts().items())


def _cells(table: pd.DataFrame, settings: CurateSettings) -> np.ndarray:
    from maglev_offline.curate.transitions import STATE

    bins = (settings.bins_gap, settings.bins_velocity, settings.bins_current, settings.bins_voltage)
    return cells_of(table[[*STATE, "voltage_deviation_v"]].to_numpy(), bins, settings.edge_quantile)


def _split(log_id: pd.Series, settings: CurateSettings) -> np.ndarray:
    """`validation` for the nearest whole number of logs, chosen by the seed; one log at least remains for training."""
    logs = np.sort(log_id.unique())
    count = min(round(settings.validation_share * len(logs)), len(logs) - 1)
    held_out = stream(settings.seed, "curate: split").permutation(logs)[:count]
    return np.where(log_id.isin(held_out), "validation", "train")


def coverage_facts(training: pd.DataFrame, curated: pd.DataFrame, settings: CurateSettings) -> dict[str, object]:
    """What balance changed: occupancy before and after, effective sample size, low-cost rows kept."""
    low = float(training["cost"].quantile(settings.low_cost_quantile))
    low_before = int((training["cost"] <= low).sum())
    low_after = int((curated["cost"] <= low).sum())
    return {
        "occupancy_before": occupancy(training["cell"].to_numpy())._asdict(),
        "occupancy_after": occupancy(curated["cell"].to_numpy())._asdict(),
        "effective_sample_size": effective_sample_size(curated["weight"].to_numpy()),
        "low_cost_threshold": low,
        "low_cost_rows_before": low_before,
        "low_cost_rows_after": low_after,
        "low_cost_share_kept": low_after / low_before,
        "mean_cost_before": float(training["cost"].mean()),
        "mean_cost_after": float(curated["cost"].mean()),
    }
