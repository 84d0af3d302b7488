"""The command that looks at the installation: doctor."""

import typer

from maglev_offline.cli.options import HERE, JsonOption, QuietOption, RecipeOption, WorkspaceOption


def add_commands(app: typer.Typer) -> None:
    """Put `doctor` into `app`."""
    app.command(epilog="Example: maglev-offline doctor --workspace workspace")(doctor)


def doctor(
    recipe: RecipeOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Say what is here and what is missing: packages, engines, cores, memory, disk, workspace; and how to get it.

    Trains for a moment to see that it works. Writes nothing that stays. Exit code 2 where something stands in the way
    of a run; --quiet leaves out what is well.
    """
    from maglev_offline.console import Talk
    from maglev_offline.doctor.check import exit_code, lines, plain
    from maglev_offline.doctor.examination import examine

    checks = examine(workspace, recipe)
    Talk(as_json=as_json, quiet=quiet).result(plain(checks), *lines(checks, quiet=quiet))
    if exit_code(checks):
        raise typer.Exit(exit_code(checks))
