"""The end of the road, and the whole of it: card, report, run."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_offline.cli.options import (
    HERE,
    BackendOption,
    JobsOption,
    JsonOption,
    PlantOption,
    QuietOption,
    RecipeOption,
    SchedulerOption,
    WorkspaceOption,
    on_workspace,
    open_session,
    settled,
    settled_logs,
)


def add_commands(app: typer.Typer) -> None:
    """Put `card`, `report` and `run` into `app`."""
    app.command(epilog="Example: maglev-offline card --out card")(on_workspace(card))
    app.command(epilog="Example: maglev-offline report")(on_workspace(report))
    app.command(epilog="Example: maglev-offline run pipelines/quickstart.toml")(on_workspace(run))


def card(
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder to copy card.json and card.html to.")] = None,
    recipe: RecipeOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write the dataset card of the transitions: JSON, and a page in which regions are chosen for the recipe."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet)
    with session.at_work("card"):
        done = pipeline.card(session.recipe, session.workspace, session.talk, out)
    session.talk.result(done.plain(), *done.lines())


def report(
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write one self-contained HTML page of everything that is in the workspace."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet, plant)
    with session.at_work("report"):
        done = pipeline.report(session.recipe, session.workspace, session.talk)
    session.talk.result(done.plain(), *done.lines())


def run(
    arguments: Annotated[
        list[str] | None,
        typer.Argument(metavar="[RECIPE] [LOGS]...", help="A recipe (or --recipe), and logs instead of its own."),
    ] = None,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    backend: BackendOption = "local",
    scheduler: SchedulerOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Go the whole road: ingest, curate, prefill, control, train, transfer, report."""
    from maglev_offline import pipeline
    from maglev_offline.ingest.inputs import find_logs

    logs = list(arguments or [])
    if recipe is None and (not logs or logs[0].endswith(".mcap")):
        raise typer.BadParameter("give a recipe: maglev-offline run pipelines/quickstart.toml", param_hint="RECIPE")
    chosen = recipe or Path(logs.pop(0))
    session = open_session(chosen, settled(workspace, backend), as_json, quiet, plant)
    paths = find_logs(logs) if logs else find_logs(session.recipe.logs, relative_to=chosen.parent)
    paths = settled_logs(paths, backend)
    with session.spread("run", backend, scheduler, jobs, paths) as at_once:
        done = pipeline.run(session.recipe, session.workspace, paths, at_once, session.talk)
    session.talk.result(done.plain(), *done.lines())
    if done.refused:
        raise typer.Exit(2)
