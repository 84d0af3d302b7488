"""Commands on data: surrogate, inspect, ingest, curate, prefill."""

from pathlib import Path
from typing import Annotated, Any

import typer

from maglev_offline.cli.options import (
    HERE,
    JobsOption,
    JsonOption,
    PlantOption,
    QuietOption,
    RecipeOption,
    WorkspaceOption,
    cores,
    open_session,
    with_options,
)


def add_commands(app: typer.Typer) -> None:
    """Put the commands on data into `app`."""
    app.command(epilog="Example: maglev-offline surrogate logs --logs 3 --duration-s 600")(surrogate)
    app.command(epilog="Example: maglev-offline inspect logs/*.mcap")(inspect)
    app.command(epilog="Example: maglev-offline ingest logs/*.mcap")(ingest)
    app.command(epilog="Example: maglev-offline curate --recipe pipelines/changsha.toml")(curate)
    app.command(epilog="Example: maglev-offline prefill --algo ddpg")(prefill)


Logs = Annotated[list[str], typer.Argument(help="MCAP files, folders of them, or patterns.")]


def surrogate(
    output: Annotated[Path, typer.Argument(help="Folder for the logs.")],
    logs: Annotated[int | None, typer.Option(min=1, help="How many logs.")] = None,
    points: Annotated[int | None, typer.Option(min=1, help="Suspension points in each log.")] = None,
    duration_s: Annotated[float | None, typer.Option(min=1, help="Length of each log, seconds.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of everything random.")] = None,
    truth: Annotated[bool, typer.Option("--truth", help="Write the 1 kHz truth beside the logs, for checks.")] = False,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write surrogate logs: simulated PID runs, marked as simulated."""
    from maglev_offline.logs.surrogate import generate

    session = with_options(
        open_session(recipe, workspace, as_json, quiet, plant),
        "surrogate",
        logs=logs,
        points=points,
        duration_s=duration_s,
        seed=seed,
    )
    paths = generate(
        output,
        plant=session.recipe.plant,
        mdp=session.recipe.mdp,
        settings=session.recipe.surrogate,
        truth=truth,
        progress=session.talk,
    )
    session.talk.result(
        {"status": "done", "logs": [str(path) for path in paths], "simulated": True, "truth": truth},
        *(f"{path} ({path.stat().st_size / 1e6:.2f} MB, simulated)" for path in paths),
    )


def inspect(
    logs: Logs,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Show what logs hold: channels, fields, rates, and the signals that would be used."""
    from maglev_offline.cli import views
    from maglev_offline.errors import LogError
    from maglev_offline.ingest.inputs import find_logs
    from maglev_offline.ingest.inspect import inspect_log

    session = open_session(recipe, workspace, as_json, quiet, plant)
    found: list[Any] = []
    refused: list[LogError] = []
    for path in find_logs(logs):
        try:
            summary = inspect_log(path, session.recipe.signals)
        except LogError as error:
            refused.append(error)
            session.talk.fail(error)
            continue
        found.append(summary)
        session.talk.table(views.heading(summary), list(views.CHANNEL_COLUMNS), views.channel_rows(summary))
        session.talk.lines(*views.remarks(summary), "")
    session.talk.result(
        {
            "status": "refused" if refused else "done",
            "logs": [summary.as_dict() for summary in found],
            "refused": [{"what": e.what, "where": e.where, "todo": e.todo} for e in refused],
        }
    )
    if refused:
        raise typer.Exit(2)


def ingest(
    logs: Logs,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Turn MCAP logs into checked samples, and those into a curated, balanced set of transitions."""
    from maglev_offline import pipeline
    from maglev_offline.ingest.inputs import find_logs
    from maglev_offline.outcomes import LOG_COLUMNS

    session = open_session(recipe, workspace, as_json, quiet, plant)
    with session.at_work("ingest"):
        done = pipeline.ingest(session.recipe, session.workspace, find_logs(logs), cores(jobs), session.talk)
    session.talk.table("Logs", list(LOG_COLUMNS), done.rows())
    session.talk.result(done.plain(), *done.lines())
    if done.refused:
        raise typer.Exit(2)


def curate(
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Curate the transitions anew from the samples, for instance after a change of the recipe."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet, plant)
    with session.at_work("curate"):
        done = pipeline.curate(session.recipe, session.workspace, session.talk)
    session.talk.result(done.plain(), *done.lines())


def prefill(
    algo: Annotated[str | None, typer.Option("--algo", help="ddpg or td3. [default: those of the recipe]")] = None,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Scale the curated transitions into the replay buffer of an algorithm."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet, plant)
    with session.at_work("prefill"):
        done = [
            pipeline.prefill(session.recipe, session.workspace, algorithm)
            for algorithm in pipeline.algorithms(session.recipe, algo)
        ]
    session.talk.result(
        {"status": "done", "prefills": [one.plain() for one in done]}, *(line for one in done for line in one.lines())
    )
