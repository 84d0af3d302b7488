"""What a process asks of its allocator: once, only where it can, and nothing else changes."""

import ctypes
import subprocess
import sys

import pytest

from maglev_offline import memory

FAULTS = """
import resource
import numpy as np
from maglev_offline.memory import keep_freed_memory
{call}
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    held = [np.ones(125_000) for _ in range(40)]
    del held
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.fixture(autouse=True)
def asked_anew():
    memory.keep_freed_memory.cache_clear()
    yield
    memory.keep_freed_memory.cache_clear()


class Library:
    """A C library that notes what it is asked."""

    def __init__(self, answers):
        self.answers, self.asked = answers, []

    def mallopt(self, option, value):
        self.asked.append((option, value))
        return self.answers[len(self.asked) - 1]


def test_elsewhere_than_on_linux_nothing_is_asked(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(ctypes, "CDLL", None)
    assert memory.keep_freed_memory() is False


def test_another_c_library_is_left_alone(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", lambda _: object())
    assert memory.keep_freed_memory() is False


@pytest.mark.parametrize(("answers", "could"), [((1, 1), True), ((1, 0), False), ((0, 0), False)])
def test_it_says_whether_it_could(monkeypatch, answers, could):
    library = Library(answers)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    assert memory.keep_freed_memory() is could
    assert library.asked[0] == (-3, 32 * 2**20)  # M_MMAP_THRESHOLD; glibc refuses a larger one


def test_a_process_asks_once(monkeypatch):
    library = Library((1, 1))
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", lambda _: library)
    assert [memory.keep_freed_memory() for _ in range(3)] == [True] * 3
    assert len(library.asked) == 2


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only where glibc is")
def test_arrays_use_the_pages_of_those_before_them_again():
    if not memory.keep_freed_memory():
        pytest.skip("another C library")
    plain, kept = (
        int(subprocess.run([sys.executable, "-c", FAULTS.format(call=call)], check=True, capture_output=True).stdout)
        for call in ("", "keep_freed_memory()")
    )
    assert kept < 0.2 * plain
