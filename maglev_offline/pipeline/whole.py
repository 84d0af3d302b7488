"""The whole road: `run`, and the page at its end."""

from __future__ import annotations

from collections.abc import Sequence

from maglev_offline.filesystems import Where
from maglev_offline.outcomes import Done, Run
from maglev_offline.pipeline.data import ingest, prefill
from maglev_offline.pipeline.learning import transfer
from maglev_offline.pipeline.plant import control
from maglev_offline.progress import Progress
from maglev_offline.recipe import Recipe
from maglev_offline.workspace import Workspace


def report(recipe: Recipe, workspace: Workspace, progress: Progress) -> Done:
    """Write the page."""
    from maglev_offline.report.stage import build_report

    page, fresh = build_report(workspace, recipe.report, recipe.plain(), recipe.name, progress=progress)
    return Done("report", page, fresh, f"{page.stat().st_size / 1e6:.2f} MB, one file, opens without a network")


def run(recipe: Recipe, workspace: Workspace, logs: Sequence[Where], jobs: int, progress: Progress) -> Run:
    """Go the whole road. A recipe without algorithms ends at the classical controllers, and reports that.

    Where no log can be used there is nothing to go on with, and the road ends at once.
    """
    ingested = ingest(recipe, workspace, logs, jobs, progress, only=True)
    if ingested.transitions is None:
        return Run(ingested, [])
    stages = [ingested.transitions]

    def done(one: Done) -> None:
        stages.append(one)
        progress.say("\n".join(one.lines()))

    progress.say("\n".join(ingested.lines()))
    done(control(recipe, workspace, progress))
    if recipe.training.algorithms:
        for algorithm in recipe.training.algorithms:
            done(prefill(recipe, workspace, algorithm))
        done(transfer(recipe, workspace, jobs, progress))
    done(report(recipe, workspace, progress))
    return Run(ingested, stages)
