"""The command line: parse, call, print. The work is done by the stages."""

import errno
import os
import re
import sys
from typing import Any, cast

import typer

from maglev_offline.cli import data, doctor, learning, policies, road
from maglev_offline.errors import InputError, MaglevOfflineError

BAD_INPUT, STOPPED = InputError.exit_code, 130
"""Exit codes beside 0 (done) and 1 (a failure of ours)."""

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


for module in (data, learning, policies, road, doctor):
    module.add_commands(app)


_ClickException: type[Exception] = typer.BadParameter.__mro__[2]
"""What a wrong command line ends in. Some typers carry a click of their own, so the class is that of theirs."""


def run() -> int:
    """Run the command line; return its exit code: 0 done, 2 bad input, 1 a failure of ours."""
    try:
        code = app(prog_name="maglev-offline", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = STOPPED
    except Exception as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # the help is the answer, and is on the screen
            return BAD_INPUT
        told = _in_words(error)
        if os.environ.get("MAGLEV_OFFLINE_DEBUG") and not isinstance(error, MaglevOfflineError | _ClickException):
            raise
        if told is None:
            told = MaglevOfflineError(
                f"a failure of maglev-offline itself: {type(error).__name__}: {error}.",
                todo="Nothing half-written was kept. "
                "Set MAGLEV_OFFLINE_DEBUG=1 to see where it came from, and report it.",
            )
        return _tell(told)
    if code == STOPPED:
        print("stopped. What is finished is kept; a training goes on at its last checkpoint.", file=sys.stderr)
    return code if isinstance(code, int) else 0


def _in_words(error: Exception) -> MaglevOfflineError | None:
    """Say what the user can mend in our own words; None for a failure of ours."""
    if isinstance(error, MaglevOfflineError):
        return error
    if isinstance(error, _ClickException):
        context: Any = getattr(error, "ctx", None)
        command = context.command_path if context else "maglev-offline"
        what = cast(Any, error).format_message().rstrip(".?")
        return InputError(
            f"{what}{'?' if 'Did you mean' in what else '.'}", where=command, todo=f"See `{command} --help`."
        )
    if isinstance(error, ModuleNotFoundError) and not str(error.name).startswith("maglev_offline"):
        what = f"the package {error.name} is not here, or not whole."
        return InputError(what, todo="`maglev-offline doctor` says what is missing, and how to get it.")
    if _no_room(error):
        todo = "Make room and give the same command again: what is finished is kept."
        return MaglevOfflineError("there is no room left to write.", where=_file_of(error), todo=todo)
    if isinstance(error, FileNotFoundError) and _file_of(error):
        what = "it is not there, or was removed while it was needed."
        return InputError(what, where=_file_of(error), todo="Put it back, or run the stage that makes it again.")
    if isinstance(error, OSError) and error.errno in _REFUSED and _file_of(error):
        what = f"it cannot be used ({os.strerror(error.errno)})."
        return InputError(what, where=_file_of(error), todo="Give another path, or make it readable and writable.")
    return None


_REFUSED = (errno.EEXIST, errno.ENOTDIR, errno.EISDIR, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG)


def _no_room(error: Exception) -> bool:
    """Whether the disk, the quota or the largest file is full; safetensors tells the number in its text only."""
    full = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    told = re.search(r"\(os error (\d+)\)", str(error)) if type(error).__name__ == "SafetensorError" else None
    return (isinstance(error, OSError) and error.errno in full) or (told is not None and int(told[1]) in full)


def _file_of(error: Exception) -> str:
    """The file that an error is about, or nothing; pyarrow names it in its text only."""
    name = getattr(error, "filename", None)
    told = re.search(r"(?:file|directory) '([^']+)'", str(error))
    return str(name) if name else told[1] if told else ""


def _tell(error: MaglevOfflineError) -> int:
    """Tell an error to people, and to the script that asked for JSON; return its exit code."""
    from maglev_offline.console import Talk

    talk = Talk(as_json="--json" in sys.argv)
    talk.fail(error)
    if talk.as_json:
        talk.result({"status": "error", "what": error.what, "where": error.where, "todo": error.todo})
    return error.exit_code
