"""Work that is spread over processes of this machine or over a cluster; joblib hands it out.

A stage names its tasks and how many may be under way. Where they are done is what `joblib.parallel_config` of the
caller says: processes here by default, or a `ClusterBackend`. Tasks are the same wherever they are done, and so are
the bytes that come of them.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import Any, ParamSpec, TypeVar

import joblib
from joblib.parallel import ParallelBackendBase, SequentialBackend, get_active_backend

from maglev_offline.errors import MaglevOfflineError

Given = ParamSpec("Given")
Made = TypeVar("Made")

Outcome = tuple[Any, Exception | None]
"""What a call gave, and the exception that it ended with, if any."""


class ClusterFailed(MaglevOfflineError):
    """The cluster could not do a task: its worker ended again and again, or the cluster itself is gone."""


def on_cluster() -> bool:
    """Whether tasks go to other machines, which see the same files and nothing else of this process."""
    return isinstance(get_active_backend()[0], ClusterBackend)


def spread(
    do: Callable[..., Made],
    tasks: Iterable[tuple[Any, ...]],
    jobs: int,
    *,
    in_order: bool = True,
) -> Iterator[Made]:
    """Do each task (the arguments of `do`), at most `jobs` at once; give what comes of them as soon as it is there.

    `in_order`: in the order of the tasks. So that large tasks do not pile up, no more than twice the jobs are handed
    out, and on a cluster, whose workers take whatever they are handed, no more than the jobs.

    Raises
    ------
    ClusterFailed: see there. What a task raises is raised here.
    """
    kind = "generator" if in_order else "generator_unordered"
    most = jobs if on_cluster() else "2*n_jobs"
    pool = joblib.Parallel(n_jobs=jobs, return_as=kind, batch_size=1, pre_dispatch=most)
    yield from pool(joblib.delayed(do)(*task) for task in tasks)


class ClusterBackend(ParallelBackendBase):
    """joblib's way to a cluster that gives a future for a call.

    joblib's own backends for Dask and Ray are not used: the one waits forever for a task that was given up, the other
    gives no results before all are there, and draws the worker of each task at random.

    `submit`: hand a call without arguments to the cluster, which does it once more where its worker was lost.
    """

    supports_retrieve_callback = True

    def __init__(self, submit: Callable[[Callable[[], Outcome]], Future[Outcome]]) -> None:
        super().__init__(nesting_level=0)
        self._submit = submit
        self._pending: set[Future[Outcome]] = set()

    def configure(self, n_jobs: int = 1, parallel: Any = None, *_: Any, **__: Any) -> int:
        """Begin a call of `joblib.Parallel`."""
        self.parallel = parallel
        return self.effective_n_jobs(n_jobs)

    def effective_n_jobs(self, n_jobs: int) -> int:
        """As many as were asked for. joblib hands all tasks out at once where that is one, so it is told two."""
        return max(2, n_jobs)

    def submit(self, func: Callable[[], Any], callback: Callable[[Any], Any] | None = None) -> Future[Outcome]:
        """Hand a batch of tasks to the cluster."""
        future = self._submit(_Caught(func))
        self._pending.add(future)
        future.add_done_callback(self._pending.discard)
        if callback is not None:
            future.add_done_callback(callback)
        return future

    def retrieve_result_callback(self, out: Any) -> Any:
        """What came of a batch; raises what a task raised."""
        try:
            made, error = out.result()
        except BaseException as lost:  # the futures of each cluster fail in their own ways, or are cancelled
            raise ClusterFailed(
                f"the cluster gave a task up ({type(lost).__name__}: {first_line(lost)}).",
                todo="Look at the logs of its scheduler and workers (were they out of memory?), and give the same "
                "command again: what is finished is kept.",
            ) from None
        if error is not None:
            raise error
        return made

    def abort_everything(self, ensure_ready: bool = True) -> None:  # noqa: ARG002
        """Ask the cluster to begin no more of what was handed to it."""
        for future in list(self._pending):
            future.cancel()
        self._pending.clear()

    def get_nested_backend(self) -> tuple[Any, None]:
        """A task does not spread its own work: it has one core."""
        return SequentialBackend(nesting_level=1), None


def first_line(error: BaseException) -> str:
    """The first line of what an exception says; those of clusters go on with the stack of another machine."""
    return next(iter(str(error).strip().splitlines()), "")


class _Caught:
    """A call that gives its exception back: each cluster wraps one that is raised in another way."""

    def __init__(self, func: Callable[[], Any]) -> None:
        self.func = func

    def __call__(self) -> Outcome:
        try:
            return self.func(), None
        except Exception as error:
            return None, error
