"""The end of the road, and the whole of it: report, run."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_offline.cli.options import (
    HERE,
    JobsOption,
    JsonOption,
    QuietOption,
    RecipeOption,
    WorkspaceOption,
    cores,
    open_session,
)


def add_commands(app: typer.Typer) -> None:
    """Put `report` and `run` into `app`."""
    app.command(epilog="Example: maglev-offline report")(report)
    app.command(epilog="Example: maglev-offline run pipelines/quickstart.toml")(run)


def report(
    recipe: RecipeOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write one self-contained HTML page of everything that is in the workspace."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet)
    with session.at_work("report"):
        done = pipeline.report(session.recipe, session.workspace, session.talk)
    session.talk.result(done.plain(), *done.lines())


def run(
    pipeline_recipe: Annotated[Path | None, typer.Argument(metavar="RECIPE", help="Recipe (TOML).")] = None,
    logs: Annotated[list[str] | None, typer.Argument(help="MCAP files instead of the recipe's own.")] = None,
    recipe: RecipeOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Go the whole road: ingest, curate, prefill, control, train, transfer, report."""
    from maglev_offline import pipeline
    from maglev_offline.ingest.inputs import find_logs

    chosen = pipeline_recipe or recipe
    if chosen is None:
        raise typer.BadParameter("give a recipe: maglev-offline run pipelines/quickstart.toml", param_hint="RECIPE")
    session = open_session(chosen, workspace, as_json, quiet)
    paths = find_logs(logs) if logs else find_logs(session.recipe.logs, relative_to=chosen.parent)
    with session.at_work("run"):
        done = pipeline.run(session.recipe, session.workspace, paths, cores(jobs), session.talk)
    session.talk.result(done.plain(), *done.lines())
    if done.refused:
        raise typer.Exit(2)
