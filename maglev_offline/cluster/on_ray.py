"""A Ray cluster: nodes of `ray start`, which do as many tasks at once as they have CPUs to give."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

from maglev_offline.cluster.machines import WAIT_S, Machines, no_workers, reach
from maglev_offline.errors import InputError
from maglev_offline.spread import first_line

PORT = 6379
LOST_MOST = 3
"""A task whose worker is lost is done again so many times, as Dask does by itself."""


@contextmanager
def connected(address: str) -> Iterator[Machines]:
    """Connect to the cluster at `host:6379`, from a machine that is one of its nodes.

    Raises
    ------
    InputError: the package is not here, nothing answers, what answers is no Ray of this version, or it has no CPUs; or
        the address is that of Ray's client, which was seen to hang.
    """
    if "://" in address:
        raise InputError(
            "the client of Ray (ray://) is not used.",
            where=address,
            todo=f"Give the command on a machine that is a node of the cluster, with --scheduler HOST:{PORT}.",
        )
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # A driver would give up on its GPUs' variables, and warns that it will: nothing here uses them.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError:
        raise InputError(
            "the package ray is not here.", where="--backend ray", todo="Run `pip install '.[ray]'`."
        ) from None
    reach(address, PORT)
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.CRITICAL, configure_logging=True)
    except Exception as error:  # of many kinds, none of them ours
        raise InputError(
            f"it cannot be connected to ({type(error).__name__}: {first_line(error)}).",
            where=address,
            todo="This machine has to be a node of the cluster (`ray start --address`), with Ray and Python of "
            "the same versions everywhere.",
        ) from None
    try:
        slots = int(ray.cluster_resources().get("CPU", 0))
        if slots < 1:
            raise no_workers(address, f"ray start --address {address}")
        yield Machines(slots, _submit, _ask)
    finally:
        ray.shutdown()


def _submit(call: Callable[[], Any]) -> Future[Any]:
    import ray

    task = ray.remote(num_cpus=1, max_retries=LOST_MOST)(_done)
    reference = task.remote(call)
    future: Future[Any] = reference.future()
    return future


def _ask(call: Callable[[], Any]) -> dict[str, Any]:
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    asked = {}
    for node in ray.nodes():
        if node["Alive"] and node["Resources"].get("CPU"):
            there = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
            asked[str(node["NodeManagerHostname"])] = ray.remote(num_cpus=0, scheduling_strategy=there)(_done).remote(
                call
            )
    found: dict[str, Any] = {}
    for name, reference in asked.items():
        try:
            found[name] = ray.get(reference, timeout=WAIT_S)
        except Exception as error:
            found[name] = error
    return found


def _done(call: Callable[[], Any]) -> Any:
    return call()
