"""A Dask cluster: workers of `dask worker`, each of which does as many tasks at once as it has threads."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from maglev_offline.cluster.machines import WAIT_S, Machines, no_workers, reach
from maglev_offline.errors import InputError
from maglev_offline.spread import first_line

PORT = 8786


@contextmanager
def connected(address: str) -> Iterator[Machines]:
    """Connect to the scheduler at `tcp://host:8786`.

    Raises
    ------
    InputError: the package is not here, nothing answers, what answers is no scheduler, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "the package distributed is not here.", where="--backend dask", todo="Run `pip install '.[dask]'`."
        ) from None
    address = address if "://" in address else f"tcp://{address}"
    reach(address, PORT)
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong is told by us
    try:
        client = Client(address, timeout=WAIT_S / 4, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"what answers there is no scheduler of Dask ({first_line(error)}).",
            where=address,
            todo=f"`dask scheduler` tells its address; its port is {PORT} unless it is told otherwise.",
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=WAIT_S / 4)
        except TimeoutError:
            raise no_workers(address, f"dask worker {address}") from None
        executor = client.get_executor(pure=False)

        def ask(call: Callable[[], Any]) -> dict[str, Any]:
            return dict(client.run(call, on_error="return"))

        yield Machines(sum(client.nthreads().values()), executor.submit, ask)
