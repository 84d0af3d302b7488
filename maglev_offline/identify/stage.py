"""The stage `identify`: samples in the workspace -> parameters with intervals, residuals, and a plant file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from maglev_offline.errors import ArtefactError
from maglev_offline.identify import verdict
from maglev_offline.identify.identification import Identified, identify
from maglev_offline.identify.plants import PLANT_FILE, fitted_plant, plant_text
from maglev_offline.identify.settings import IdentifySettings
from maglev_offline.ingest.drawing import drawn_samples
from maglev_offline.physics.parameters import Plant
from maglev_offline.progress import SILENT, Progress
from maglev_offline.tables import write_parquet
from maglev_offline.workspace import Manifest, Workspace, fingerprint, input_hash

KIND = "identify"
COLUMNS = ("parameter", "declared", "estimate +- standard error", "interval", "verdict")
"""Heads of the table for people, see `summary`."""


def run_identify(
    workspace: Workspace,
    folders: Sequence[Path],
    plant: Plant,
    settings: IdentifySettings,
    progress: Progress = SILENT,
) -> tuple[Path, bool]:
    """Commit `identify/` (parameters.parquet, residuals.parquet, plant.toml); return its folder and novelty.

    `folders`: the samples artefacts to fit. Warnings are told each time, also of an artefact that is left as it is.

    Raises
    ------
    ArtefactError: there are no samples.
    InputError: the samples cannot be fitted; the number that is wrong is told.
    """
    if not folders:
        raise ArtefactError(
            "there are no samples to identify the plant from.",
            where=str(workspace.root),
            todo="Run `maglev-offline ingest LOGS...` first.",
        )
    folders = sorted(folders)
    inputs = {f"samples/{folder.name}": input_hash(folder) for folder in folders}
    home = workspace.path(KIND)
    mark = fingerprint(KIND, inputs, plant, settings)
    if workspace.is_current(home, mark):
        for text in Manifest.read(home).facts["warnings"]:
            progress.warn(text)
        return home, False
    drawn = drawn_samples(folders, settings.most_samples, settings.seed)
    found = identify(drawn.samples, plant, settings, where=str(workspace.path("samples")))
    for text in found.warnings:
        progress.warn(text)
    made, source = fitted_plant(plant, found.parameters)
    if drawn.left:
        progress.say(
            f"identify: {len(drawn.samples):,} of {drawn.there:,} samples are drawn, minutes of a point at random "
            "(identify.most_samples)."
        )
    manifest = Manifest(KIND, mark, inputs, left_out=found.left_out)
    manifest.counts = {"samples": drawn.there, "samples_not_drawn": drawn.left, **found.counts}
    manifest.settings = {"identify": settings.model_dump(mode="json"), "plant": plant.model_dump(mode="json")}
    manifest.facts = _facts(found, made)
    with workspace.commit(home, manifest) as draft:
        write_parquet(pd.DataFrame([verdict.plain(p) for p in found.parameters]), draft / "parameters.parquet")
        write_parquet(found.residuals, draft / "residuals.parquet")
        (draft / PLANT_FILE).write_text(plant_text(made, source), encoding="utf-8")
    return home, True


def _facts(found: Identified, made: Plant) -> dict[str, Any]:
    return {
        **found.facts,
        "parameters": {p.name: verdict.plain(p) for p in found.parameters},
        "rows": verdict.table_rows(found.parameters),
        "plant": made.model_dump(mode="json"),
        "warnings": list(found.warnings),
    }


def summary(folder: Path) -> tuple[str, list[list[str]], dict[str, Any]]:
    """Read an `identify/` artefact for the command line: a sentence, rows of `COLUMNS`, facts for scripts."""
    manifest = Manifest.read(folder)
    facts = dict(manifest.facts)
    rows = facts.pop("rows")
    verdicts = [one["verdict"] for one in facts["parameters"].values()]
    sentence = (
        f"{manifest.counts['free_rows']:,} free rows, {manifest.counts['windows']:,} windows of "
        f"{facts['window_s'] * 1e3:.0f} ms: {verdicts.count(verdict.IDENTIFIED)} of {len(verdicts)} parameters "
        f"identified, {verdicts.count(verdict.WEAK)} weakly"
    )
    if "voltage_check" in facts:
        sentence += f". {facts['voltage_check']['text']}"
    if "balance_check" in facts:
        sentence += f" {facts['balance_check']['text']}"
    return sentence, rows, {"counts": manifest.counts, "left_out": manifest.left_out, **facts}
