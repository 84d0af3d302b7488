import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from joblib import parallel_config

from maglev_offline.errors import InputError
from maglev_offline.spread import ClusterBackend, ClusterFailed, on_cluster, spread


@pytest.fixture
def pool():
    with ThreadPoolExecutor(8) as threads:
        yield threads


@pytest.fixture
def cluster(pool):
    """Eight threads that stand for the workers of a cluster."""
    with parallel_config(backend=ClusterBackend(pool.submit)):
        yield


def slow_square(number):
    time.sleep(0.05 * (5 - number % 5))
    return number**2


def test_what_comes_of_tasks_is_in_their_order_here():
    assert not on_cluster()
    assert list(spread(slow_square, ((k,) for k in range(6)), 1)) == [k**2 for k in range(6)]


@pytest.mark.usefixtures("cluster")
def test_what_comes_of_tasks_is_in_their_order_on_a_cluster():
    assert on_cluster()
    assert list(spread(slow_square, ((k,) for k in range(12)), 4)) == [k**2 for k in range(12)]


@pytest.mark.usefixtures("cluster")
def test_out_of_order_the_first_that_is_done_comes_first():
    assert list(spread(slow_square, ((k,) for k in range(5)), 5, in_order=False)) == [16, 9, 4, 1, 0]


@pytest.mark.usefixtures("cluster")
@pytest.mark.parametrize("jobs", [1, 3])
def test_no_more_tasks_than_jobs_are_under_way(jobs):
    lock, now, most = threading.Lock(), [0], [0]

    def work(number):
        with lock:
            now[0] += 1
            most[0] = max(most[0], now[0])
        time.sleep(0.02)
        with lock:
            now[0] -= 1
        return number

    assert list(spread(work, ((k,) for k in range(12)), jobs)) == list(range(12))
    assert most[0] == jobs


def refuse(number):
    raise InputError(f"task {number}.", where="there", todo="Look.")


@pytest.mark.usefixtures("cluster")
def test_what_a_task_raises_is_raised_here():
    with pytest.raises(InputError, match="task 0") as raised:
        list(spread(refuse, ((k,) for k in range(3)), 1))
    assert (raised.value.where, raised.value.todo) == ("there", "Look.")


def test_a_task_that_the_cluster_gives_up_ends_in_words():
    def give_up(_):
        future = Future()
        future.set_exception(RuntimeError("the worker died three times\nand more"))
        return future

    with (
        parallel_config(backend=ClusterBackend(give_up)),
        pytest.raises(ClusterFailed, match=r"RuntimeError: the worker died three times\)\. Look at the logs"),
    ):
        list(spread(slow_square, [(1,), (2,)], 2))


def test_tasks_that_are_cancelled_because_the_cluster_is_gone_end_in_words():
    def cancelled(_):
        future = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future

    with parallel_config(backend=ClusterBackend(cancelled)), pytest.raises(ClusterFailed, match="CancelledError"):
        list(spread(slow_square, [(1,), (2,)], 2))


def spread_within(number):
    return list(spread(slow_square, ((number + k,) for k in range(2)), 1)), on_cluster()


@pytest.mark.usefixtures("cluster")
def test_a_task_does_its_own_work_alone():
    assert list(spread(spread_within, [(3,)], 2)) == [([9, 16], False)]
