"""The command line: parse, call, print. The work is done by the stages."""

import os
import sys

import click
import typer

from maglev_offline.cli import data, learning, road

app = typer.Typer(
    name="maglev-offline",
    help="Can logged PID data teach a better maglev suspension controller, or does it harm?\n\n"
    "MCAP logs -> samples -> transitions -> prefill -> learning curves -> transfer verdict -> report.",
    epilog="The whole road at once: maglev-offline run pipelines/quickstart.toml",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    add_completion=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from maglev_offline import __version__

        typer.echo(f"maglev-offline {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(
        False, "--version", help="Print the version and stop.", callback=_version, is_eager=True
    ),
) -> None:
    pass


for module in (data, learning, road):
    module.add_commands(app)


def run() -> int:
    """Run the command line; return its exit code: 0 done, 2 bad input, 1 a failure of ours."""
    from maglev_offline.console import Talk
    from maglev_offline.errors import MaglevOfflineError

    try:
        code = app(standalone_mode=False)
        return code if isinstance(code, int) else 0
    except click.exceptions.Exit as stop:
        return int(stop.exit_code)
    except click.ClickException as error:
        error.show()
        return int(error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        print("stopped. What was finished is kept; the same command goes on from there.", file=sys.stderr)
        return 130
    except MaglevOfflineError as error:
        talk = Talk(as_json="--json" in sys.argv)
        talk.fail(error)
        if talk.as_json:
            talk.result({"status": "error", "what": error.what, "where": error.where, "todo": error.todo})
        return error.exit_code
    except Exception as error:
        if os.environ.get("MAGLEV_OFFLINE_DEBUG"):
            raise
        failure = MaglevOfflineError(
            f"a failure of maglev-offline itself: {type(error).__name__}: {error}.",
            todo="Nothing half-written was kept. Set MAGLEV_OFFLINE_DEBUG=1 to see where it came from, and report it.",
        )
        Talk().fail(failure)
        return failure.exit_code
