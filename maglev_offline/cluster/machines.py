"""What a cluster is to us: calls go in, futures come out, and each of its machines can be asked."""

from __future__ import annotations

import socket
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NamedTuple

from maglev_offline.errors import InputError

REACH_S = 10.0
"""So long a scheduler may take to answer at all."""

WAIT_S = 60.0
"""So long the first worker may take to be there, and each to answer what it is asked."""


class Machines(NamedTuple):
    """A cluster that is connected. `slots`: tasks that it does at once, each on one core.

    `submit`: do a call once on any worker, and again where that was lost. `ask`: do a call on every worker (Dask) or
    every node (Ray), and give name and outcome of each, an exception where it failed.
    """

    slots: int
    submit: Callable[[Callable[[], Any]], Future[Any]]
    ask: Callable[[Callable[[], Any]], dict[str, Any]]


def reach(address: str, default_port: int) -> None:
    """Look whether anything listens at an address, before a client tries for minutes.

    Raises
    ------
    InputError: nothing does, or it is no address.
    """
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not host or not port.isdigit():
        raise InputError(
            "this is no address of a scheduler.", where=address, todo=f"Write it like HOST:{default_port}."
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=REACH_S).close()
    except (OSError, OverflowError) as error:
        raise InputError(
            f"nothing answers there ({error}).",
            where=address,
            todo="Is the scheduler running, is that its port, and does a firewall let this machine through?",
        ) from None


def no_workers(address: str, how: str) -> InputError:
    """The error of a cluster without workers; `how` to start one."""
    return InputError("the cluster has no workers.", where=address, todo=f"Start some: `{how}` on each machine.")
