"""Commands on data: surrogate, inspect, ingest, curate, prefill."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from maglev_offline.cli import completion
from maglev_offline.cli.options import (
    HERE,
    AlgoOption,
    BackendOption,
    JobsOption,
    JsonOption,
    PlantOption,
    QuietOption,
    RecipeOption,
    SchedulerOption,
    WorkspaceOption,
    cores,
    on_workspace,
    open_session,
    settled,
    settled_logs,
    with_options,
)
from maglev_offline.errors import InputError


def add_commands(app: typer.Typer) -> None:
    """Put the commands on data into `app`."""
    app.command(epilog="Example: maglev-offline surrogate logs --logs 3 --duration-s 600")(on_workspace(surrogate))
    app.command(epilog="Example: maglev-offline inspect logs/*.mcap")(on_workspace(inspect))
    app.command(epilog="Example: maglev-offline ingest logs/*.mcap")(on_workspace(ingest))
    app.command(epilog="Example: maglev-offline curate --recipe pipelines/changsha.toml")(on_workspace(curate))
    app.command(epilog="Example: maglev-offline prefill --algo ddpg")(on_workspace(prefill))


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


FailOn = Literal["never", "info", "warning", "error"]


def inspect(
    logs: Logs,
    fail_on: Annotated[
        FailOn, typer.Option("--fail-on", help="The least severity that ends in exit code 1 (warning) or 2 (error).")
    ] = "error",
    html: Annotated[Path | None, typer.Option("--html", help="Write the findings as one HTML page.")] = None,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Look at logs: channels, rates, the signals that would be used, and what the checks find wrong.

    Exit code 0 where nothing is as severe as --fail-on, else 1 where the worst is a warning and 2 where it is an error.
    """
    from maglev_offline.cli import views
    from maglev_offline.ingest.inputs import find_logs
    from maglev_offline.ingest.inspect_many import inspect_logs

    if html is not None:
        _refuse_page(html)
    session = open_session(recipe, workspace, as_json, quiet, plant)
    found = inspect_logs(find_logs(logs), session.recipe.request, jobs=cores(jobs), progress=session.talk)
    for one in found.logs:
        session.talk.table(views.heading(one.summary), list(views.CHANNEL_COLUMNS), views.channel_rows(one.summary))
        session.talk.lines(*map(session.talk.once, views.remarks(one.summary)), *views.finding_lines(one.findings), "")
    session.talk.lines(*views.finding_lines(found.across))
    if html is not None:
        from maglev_offline.filesystems import write_whole
        from maglev_offline.ingest.inspect_page import inspect_page

        page = inspect_page([one.summary.as_dict() for one in found.logs], found.findings)
        write_whole(html, page.encode("utf-8", errors="backslashreplace"))
        session.talk.lines(f"The page: {html}")
    session.talk.result(
        {
            "status": "refused" if found.refused else "done",
            "worst": found.worst,
            "logs": [
                {**one.summary.as_dict(), "findings": [views.plain_finding(finding) for finding in one.findings]}
                for one in found.logs
            ],
            "across": [views.plain_finding(finding) for finding in found.across],
            "refused": [{"what": e.what, "where": e.where, "todo": e.todo} for e in found.refused],
        }
    )
    code = 2 if found.refused else found.exit_code(fail_on)
    if code:
        raise typer.Exit(code)


def _refuse_page(html: Path) -> None:
    """Before a thousand logs are looked at, not after.

    Raises
    ------
    InputError: the page cannot lie there.
    """
    if html.is_dir():
        raise InputError("this is a folder, and the page is a file.", where=str(html), todo="Give the name of a file.")
    if not html.parent.is_dir():
        raise InputError(
            "there is no such folder.", where=str(html.parent), todo="Make it first, or give another path to --html."
        )


def ingest(
    logs: Logs,
    start: Annotated[str | None, typer.Option(help="Use messages from this time on: ISO 8601, or +12.5s.")] = None,
    end: Annotated[str | None, typer.Option(help="Use messages before this time.")] = None,
    topic: Annotated[list[str] | None, typer.Option(help="Use these topics only (name or pattern with *).")] = None,
    exclude_topic: Annotated[list[str] | None, typer.Option(help="Leave these topics out.")] = None,
    point: Annotated[list[str] | None, typer.Option(help="Use these suspension points only.")] = None,
    where: Annotated[list[str] | None, typer.Option(help="Use samples that fulfil this, as 'speed_m_s > 5'.")] = None,
    merge: Annotated[bool, typer.Option("--merge", help="The logs are parts of one recording.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would come of it, and write nothing.")] = False,
    rehash: Annotated[bool, typer.Option("--rehash", help="Read every file again, even untouched ones.")] = False,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    backend: BackendOption = "local",
    scheduler: SchedulerOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Turn MCAP logs into checked samples, and those into a curated, balanced set of transitions."""
    from maglev_offline import pipeline
    from maglev_offline.ingest.inputs import find_logs
    from maglev_offline.outcomes import LOG_COLUMNS

    lists = {"topics": topic, "exclude_topics": exclude_topic, "points": point, "where": where}
    session = with_options(
        open_session(recipe, settled(workspace, backend), as_json, quiet, plant, rehash=rehash),
        "select",
        start=start,
        end=end,
        **{name: given or None for name, given in lists.items()},
    )
    found = settled_logs(find_logs(logs), backend)
    if dry_run and backend != "local":
        raise InputError("--dry-run writes nothing, and looks here.", where="--backend", todo="Leave one of them out.")
    if dry_run:
        done = pipeline.would_ingest(session.recipe, found, cores(jobs), session.talk, merge=merge)
    else:
        with session.spread("ingest", backend, scheduler, jobs, found) as at_once:
            done = pipeline.ingest(session.recipe, session.workspace, found, at_once, session.talk, merge=merge)
    session.talk.table("Logs", list(LOG_COLUMNS), done.rows())
    session.talk.result(done.plain(), *done.lines())
    if done.refused:
        raise typer.Exit(2)


FailOnVerdict = Literal["never", "doubtful", "harmful"]


def curate(
    construction: Annotated[
        str | None,
        typer.Option(
            "--construction",
            help="raw, semi_markov, interpolated, consistent, reconstructed or simulated_next. [default: the recipe's]",
            autocompletion=completion.one_of(completion.CONSTRUCTIONS),
        ),
    ] = None,
    balance: Annotated[
        str | None,
        typer.Option(
            "--balance",
            help="cells, quantiles, inverse_density, coverage, low_cost or none. [default: the recipe's]",
            autocompletion=completion.one_of(completion.BALANCES),
        ),
    ] = None,
    fail_on: Annotated[
        FailOnVerdict,
        typer.Option("--fail-on", help="The least verdict that ends in exit code 1 (doubtful) or 2 (harmful)."),
    ] = "never",
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    backend: BackendOption = "local",
    scheduler: SchedulerOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Curate the transitions anew from the samples, and say whether they teach the truth.

    Exit code 0 where the verdict is not as bad as --fail-on, else 1 where it is doubtful and 2 where it is harmful.
    """
    from maglev_offline import pipeline
    from maglev_offline.curate.words import exit_code

    session = open_session(recipe, settled(workspace, backend), as_json, quiet, plant)
    session = with_options(session, "curate", construction=construction, balance=balance)
    with session.spread("curate", backend, scheduler, jobs) as at_once:
        done = pipeline.curate(session.recipe, session.workspace, at_once, session.talk)
    session.talk.result(done.plain(), *done.lines())
    code = exit_code(done.data["diagnostic"]["verdict"], fail_on)
    if code:
        raise typer.Exit(code)


def prefill(
    algo: AlgoOption = None,
    form: Annotated[
        Literal["native", "npz", "sb3", "d3rlpy", "minari", "torchrl"],
        typer.Option("--format", help="Write it for another library too; d3rlpy and minari need the extra `exports`."),
    ] = "native",
    capacity: Annotated[
        int | None, typer.Option("--capacity", min=1, help="Slots of the buffer it is for: refuse what does not fit.")
    ] = None,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Scale the curated transitions into the replay buffer of an algorithm, and write it as other libraries read it."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet, plant)
    made, root = session.recipe, session.workspace
    with session.at_work("prefill"):
        wanted = pipeline.algorithms(made, algo)
        done = [pipeline.prefill(made, root, algorithm, capacity) for algorithm in wanted]
        exports = []
        if form != "native":
            exports = [pipeline.export_prefill(made, root, algorithm, form) for algorithm in wanted]
    session.talk.result(
        {"status": "done", "prefills": [one.plain() for one in done], "exports": [one.plain() for one in exports]},
        *(line for one in (*done, *exports) for line in one.lines()),
    )
