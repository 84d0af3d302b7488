"""Where a command's tasks are done: processes here, or the workers of a cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, get_args

from maglev_offline.errors import InputError
from maglev_offline.filesystems import Where
from maglev_offline.machine import usable_cores
from maglev_offline.progress import Progress

Backend = Literal["local", "dask", "ray"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)


@contextmanager
def workers(
    backend: Backend,
    scheduler: str | None,
    jobs: int | None,
    root: Path,
    progress: Progress,
    logs: Sequence[Where] = (),
) -> Iterator[int]:
    """Give how many tasks may be under way at once: `jobs`, or as many as there are cores here or slots there.

    On a cluster every worker is first asked whether it sees the workspace `root` and the local `logs`, and has the
    same code.

    Raises
    ------
    InputError: a backend without its scheduler or the other way round; the cluster cannot be reached or used.
    """
    if backend == "local":
        if scheduler:
            raise InputError("an address without a cluster.", where="--scheduler", todo="Add --backend dask or ray.")
        yield jobs or usable_cores()
        return
    if not scheduler:
        port = {"dask": "tcp://HOST:8786", "ray": "HOST:6379"}[backend]
        raise InputError("where is the cluster?", where=f"--backend {backend}", todo=f"Add --scheduler {port}.")

    from joblib import parallel_config

    from maglev_offline.cluster import on_dask, on_ray
    from maglev_offline.cluster.same import check
    from maglev_offline.spread import ClusterBackend

    with (on_dask if backend == "dask" else on_ray).connected(scheduler) as machines:
        check(machines.ask, root, tuple(log for log in logs if isinstance(log, Path)), progress)
        at_once = min(jobs or machines.slots, machines.slots)
        progress.say(f"{backend} at {scheduler}: {machines.slots} tasks at once, {at_once} of them used.")
        with parallel_config(backend=ClusterBackend(machines.submit)):
            yield at_once
