import socket
import sys

import pytest

from maglev_offline.cluster import workers
from maglev_offline.errors import InputError
from maglev_offline.progress import SILENT
from maglev_offline.spread import on_cluster


def opened(backend, scheduler, tmp_path, jobs=None):
    with workers(backend, scheduler, jobs, tmp_path, SILENT) as at_once:
        return at_once, on_cluster()


def test_without_a_cluster_the_jobs_are_processes_here(tmp_path):
    assert opened("local", None, tmp_path, 3) == (3, False)
    assert opened("local", None, tmp_path)[0] >= 1


def test_an_address_without_a_cluster_is_refused(tmp_path):
    with pytest.raises(InputError, match="Add --backend dask or ray"):
        opened("local", "tcp://host:8786", tmp_path)


@pytest.mark.parametrize(("backend", "port"), [("dask", "8786"), ("ray", "6379")])
def test_a_cluster_without_an_address_is_refused(tmp_path, backend, port):
    with pytest.raises(InputError, match=rf"--backend {backend}: .*--scheduler .*HOST:{port}"):
        opened(backend, None, tmp_path)


@pytest.mark.parametrize(("backend", "package"), [("dask", "distributed"), ("ray", "ray")])
def test_a_package_that_is_not_here_is_told_of(tmp_path, monkeypatch, backend, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"the package {package} is not here.*pip install '\.\[{backend}\]'"):
        opened(backend, "127.0.0.1:9", tmp_path)


def test_the_client_of_ray_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"\(ray://\) is not used.*node of the cluster"):
        opened("ray", "ray://127.0.0.1:10001", tmp_path)


@pytest.mark.parametrize("address", ["host", ":8786", "host:port"])
@pytest.mark.parametrize("backend", ["dask", "ray"])
def test_what_is_no_address_is_refused(tmp_path, backend, address):
    pytest.importorskip("distributed" if backend == "dask" else "ray")
    with pytest.raises(InputError, match="no address of a scheduler"):
        opened(backend, address, tmp_path)


@pytest.mark.parametrize("backend", ["dask", "ray"])
def test_an_address_where_nobody_listens_is_told_of_at_once(tmp_path, backend):
    pytest.importorskip("distributed" if backend == "dask" else "ray")
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        with pytest.raises(InputError, match=r"nothing answers there .*Is the scheduler running"):
            opened(backend, f"127.0.0.1:{closed.getsockname()[1]}", tmp_path)
