"""What the commands on logs and transitions do: `ingest`, `curate`, `prefill`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from maglev_offline.agents.settings import Algorithm
from maglev_offline.errors import ArtefactError
from maglev_offline.filesystems import Where
from maglev_offline.outcomes import Done, Ingested
from maglev_offline.progress import Progress
from maglev_offline.recipe import Recipe
from maglev_offline.workspace import Manifest, Workspace

if TYPE_CHECKING:
    from maglev_offline.replay.exports.stage import Name as ExportForm


def ingest(
    recipe: Recipe,
    workspace: Workspace,
    logs: Sequence[Where],
    jobs: int,
    progress: Progress,
    *,
    only: bool = False,
    merge: bool = False,
) -> Ingested:
    """Ingest logs, then curate the transitions of all logs in the workspace, or of `only` these.

    `merge`: the logs are parts of one recording.

    Nothing is curated if none of these logs is usable.
    """
    from maglev_offline.ingest.store import ingest_logs

    result = ingest_logs(logs, workspace, recipe.request, jobs=jobs, merge=merge, progress=progress)
    if not result.folders:
        return Ingested(list(result.logs), None)
    _tell_shared(recipe, workspace, progress)
    curated = curate(recipe, workspace, jobs, progress, folders=result.folders if only else None)
    return Ingested(list(result.logs), curated)


def _tell_shared(recipe: Recipe, workspace: Workspace, progress: Progress) -> None:
    from maglev_offline.ingest.shared_content import find_shared_content
    from maglev_offline.ingest.store import samples_made_with

    folders, _ = samples_made_with(workspace, recipe.request)
    shared = find_shared_content(workspace, {folder: workspace.manifest(folder) for folder in folders})
    for finding in shared[:_MOST_SHARED]:
        progress.warn(f"{finding.log}, point {finding.point}: {finding.what} {finding.todo}")
    if len(shared) > _MOST_SHARED:
        progress.warn(f"{len(shared) - _MOST_SHARED:,} more such findings are in {workspace.path('shared_content')}.")


_MOST_SHARED = 8
"""So many findings of shared content are told; the artefact has all."""


def would_ingest(
    recipe: Recipe, logs: Sequence[Where], jobs: int, progress: Progress, *, merge: bool = False
) -> Ingested:
    """Say what would come of logs, and write nothing."""
    from maglev_offline.ingest.store import dry_run

    return Ingested(list(dry_run(logs, recipe.request, jobs=jobs, merge=merge, progress=progress).logs), None)


def curate(
    recipe: Recipe, workspace: Workspace, jobs: int, progress: Progress, *, folders: Sequence[Path] | None = None
) -> Done:
    """Curate transitions from `folders`, or from those samples in the workspace that this recipe made.

    Raises
    ------
    ArtefactError: there are no samples, or only such as another recipe made.
    """
    from maglev_offline.curate.recovery.words import recovery_words
    from maglev_offline.curate.stage import curate as run_curate
    from maglev_offline.curate.words import balance_words, residual_lines, verdict_words

    if folders is None:
        folders = fitting_samples(recipe, workspace, progress)
    folder, fresh = run_curate(
        workspace,
        recipe.curate,
        recipe.plant,
        recipe.mdp,
        pid=recipe.control.pid,
        cascade=recipe.control.cascade,
        folders=folders,
        jobs=jobs,
        progress=progress,
    )
    manifest = Manifest.read(folder)
    judged = {name: manifest.facts[name] for name in ("construction", "diagnostic", "recovery", "residual")}
    return Done(
        "curate",
        folder,
        fresh,
        f"{manifest.counts['transitions']:,} transitions of {manifest.counts['candidates']:,} usable ones, from "
        f"{len(manifest.inputs)} log{'s' * (len(manifest.inputs) != 1)} in the workspace; "
        f"{balance_words(manifest.facts)}",
        {
            "counts": manifest.counts,
            "left_out": manifest.left_out,
            "coverage": {name: fact for name, fact in manifest.facts.items() if name not in judged},
            **judged,
        },
        notes=[
            verdict_words(manifest.facts),
            recovery_words(manifest.facts["recovery"]),
            *residual_lines(manifest.facts),
        ],
    )


def fitting_samples(recipe: Recipe, workspace: Workspace, progress: Progress) -> list[Path]:
    """The samples that this recipe made; others do not go with them, and are named."""
    from maglev_offline.ingest.store import samples_made_with

    folders, others = samples_made_with(workspace, recipe.request)
    if others:
        named = ", ".join([*(folder.name for folder in others[:3]), *["..."] * (len(others) > 3)])
        text = (
            f"samples of {len(others)} of {len(folders) + len(others)} logs were made with other [signals], [ingest] "
            f"or [plant] than this recipe has ({named})"
        )
        todo = "Ingest those logs again with this recipe, and with this --plant where one is given."
        if not folders:
            raise ArtefactError(f"{text}.", where=str(workspace.path("samples")), todo=todo)
        progress.warn(f"{text} and are left out. {todo}")
    return folders


def prefill(recipe: Recipe, workspace: Workspace, algorithm: Algorithm, capacity: int | None = None) -> Done:
    """Make the prefill of one algorithm; `capacity`: slots of the buffer that it must fit into."""
    from maglev_offline.curate.words import verdict_words
    from maglev_offline.replay.prefill import make_prefill

    folder, fresh = make_prefill(workspace, algorithm, recipe.prefill, recipe.plant, recipe.mdp, capacity=capacity)
    manifest, curated = Manifest.read(folder), Manifest.read(workspace.path("transitions")).facts
    return Done(
        "prefill",
        folder,
        fresh,
        f"{manifest.counts['rows']:,} rows for {algorithm}, actions up to {manifest.facts['largest_action']:.2f} "
        f"of the voltage limit, mean cost {manifest.facts['mean_cost']:.3g}; {verdict_words(curated)}",
        {
            "algorithm": algorithm,
            "rows": manifest.counts["rows"],
            "left_out": manifest.left_out,
            "construction": curated.get("construction"),
            "diagnostic": curated.get("diagnostic"),
        },
    )


def export_prefill(recipe: Recipe, workspace: Workspace, algorithm: Algorithm, form: ExportForm) -> Done:
    """Write the prefill of one algorithm as another library reads it."""
    from maglev_offline.replay.exports.stage import FORMS, make_export

    folder, fresh = make_export(workspace, algorithm, form, recipe.plant, recipe.mdp)
    facts, rows = Manifest.read(folder).facts, Manifest.read(folder).counts["rows"]
    how = FORMS[form].how.format(path=folder)
    return Done(
        "export",
        folder,
        fresh,
        f"{rows:,} rows of {algorithm} for {facts['written_for']}, gamma {facts['gamma']:g}; load them with\n"
        f"     {how}",
        {"algorithm": algorithm, "rows": rows, "how": how, **facts},
    )
