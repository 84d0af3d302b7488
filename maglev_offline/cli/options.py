"""Options that every command shares, and the session that they open."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, ParamSpec

import typer

from maglev_offline.cli import completion

if TYPE_CHECKING:
    from maglev_offline.cluster import Backend
    from maglev_offline.console import Talk
    from maglev_offline.filesystems import Where
    from maglev_offline.recipe import Recipe
    from maglev_offline.workspace import Workspace

RecipeOption = Annotated[
    Path | None,
    typer.Option(
        "--recipe",
        "-r",
        help="Recipe (TOML). Default: the one the workspace was last given.",
        autocompletion=completion.recipes,
    ),
]
WorkspaceOption = Annotated[
    str,
    typer.Option(
        "--workspace", "-w", help="Folder or address (s3://...) of the artefacts.", envvar="MAGLEV_OFFLINE_WORKSPACE"
    ),
]
PlantOption = Annotated[
    Path | None,
    typer.Option("--plant", help=r"File with the \[plant] to use instead of the recipe's, as `identify` writes it."),
]
AlgoOption = Annotated[
    str | None,
    typer.Option(
        "--algo",
        help="ddpg or td3. [default: those of the recipe]",
        autocompletion=completion.one_of(completion.ALGORITHMS),
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document, for scripts.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no remarks.")]
JobsOption = Annotated[
    int | None,
    typer.Option(
        "--jobs", "-j", min=1, help="Processes, or tasks on a cluster; the bytes are the same. [default: all]"
    ),
]

BackendOption = Annotated[
    Literal["local", "dask", "ray"],
    typer.Option(
        "--backend",
        envvar="MAGLEV_OFFLINE_BACKEND",
        help="Where the work is done: in processes here, or on a cluster, with --scheduler; the bytes are the same.",
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        envvar="MAGLEV_OFFLINE_SCHEDULER",
        help="Address of the cluster: tcp://HOST:8786 (Dask), HOST:6379 (Ray, from one of its nodes).",
    ),
]

HERE = "workspace"
"""The default workspace."""


@dataclass(frozen=True)
class Session:
    """What a command works with. `given`: the recipe of the command line, without what its options change."""

    recipe: "Recipe"
    workspace: "Workspace"
    talk: "Talk"
    given: "Recipe | None"

    @contextmanager
    def at_work(self, command: str) -> Iterator[None]:
        """Hold the workspace, and let it remember the recipe that it was given once the work is done."""
        from maglev_offline.recipe import remember

        with self.workspace.lock(command):
            yield
            if self.given is not None:
                remember(self.workspace.root, self.given)

    @contextmanager
    def spread(
        self,
        command: str,
        backend: "Backend",
        scheduler: str | None,
        jobs: int | None,
        logs: "Sequence[Where]" = (),
    ) -> Iterator[int]:
        """Be at work, on a cluster where one is given; gives how many tasks may go on at once."""
        from maglev_offline.cluster import workers

        with (
            self.at_work(command),
            workers(backend, scheduler, jobs, self.workspace.root, self.talk, logs) as at_once,
        ):
            yield at_once


def open_session(
    recipe: Path | None,
    workspace: str,
    as_json: bool,
    quiet: bool,
    plant: Path | None = None,
    *,
    rehash: bool = False,
) -> Session:
    """Load the recipe that is given, or the one that the workspace remembers, or the defaults.

    `plant`: file of a plant that takes the place of the recipe's; `rehash`: trust no hash that was kept.
    """
    from maglev_offline.console import Talk
    from maglev_offline.recipe import Recipe, load_recipe, recall
    from maglev_offline.workspace import Workspace

    root = Path(workspace)
    found = load_recipe(recipe) if recipe is not None else recall(root) or Recipe()
    talk = Talk(as_json=as_json, quiet=quiet)
    if recipe is None and found.name != "defaults":
        talk.say(f"recipe: {found.name} (remembered by {workspace})")
    if plant is not None:
        from maglev_offline.identify.plants import load_plant

        found = found.model_copy(update={"plant": load_plant(plant)})
    given = found if recipe is not None or plant is not None else None
    return Session(found, Workspace(root, rehash=rehash), talk, given)


Command = ParamSpec("Command")


def on_workspace(command: Callable[Command, None]) -> Callable[Command, None]:
    """Let a command work in a local mirror where its workspace is an address; what it made is brought there."""

    @wraps(command)
    def run(*args: Command.args, **kwargs: Command.kwargs) -> None:
        where: Any = kwargs["workspace"]
        if "://" not in where:
            command(*args, **kwargs)
            return
        from maglev_offline.console import Talk
        from maglev_offline.remote import open_workspace

        talk = Talk(as_json=bool(kwargs["as_json"]), quiet=bool(kwargs["quiet"]))
        with open_workspace(where, command=command.__name__, progress=talk) as root:
            kwargs["workspace"] = str(root)
            command(*args, **kwargs)

    return run


def with_options(session: Session, table: str, **given: int | float | str | list[str] | None) -> Session:
    """Put what was given as options into a table of the recipe, which judges them.

    Raises
    ------
    RecipeError: the table cannot hold it.
    """
    from maglev_offline.recipe import parse_recipe

    numbers = {key: value for key, value in given.items() if value is not None}
    if not numbers:
        return session
    data = session.recipe.plain()
    data[table] |= numbers
    return replace(session, recipe=parse_recipe(data, ", ".join(f"--{key.replace('_', '-')}" for key in numbers)))


def settled(workspace: str, backend: str) -> str:
    """The workspace as the workers of a cluster find it, whose current folder is another."""
    return workspace if backend == "local" else str(Path(workspace).absolute())


def settled_logs(logs: "Sequence[Where]", backend: str) -> "list[Where]":
    """The same for logs."""
    return [log.absolute() if isinstance(log, Path) and backend != "local" else log for log in logs]


def cores(jobs: int | None) -> int:
    """The number of processes to use."""
    from maglev_offline.machine import usable_cores

    return jobs or usable_cores()
