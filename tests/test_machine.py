import os

import pytest

from maglev_offline import machine


def test_cores_are_those_that_the_process_may_use(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 3, 5}, raising=False)
    assert machine.usable_cores() == 3


def test_a_system_that_does_not_tell_gives_all_cores(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)  # as on macOS
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    assert machine.usable_cores() == 8


@pytest.mark.parametrize(("limit", "total"), [("1000000\n", 1_000_000), ("max\n", None), (None, None)])
def test_the_limit_of_a_container_counts_where_it_is_lower(monkeypatch, tmp_path, limit, total):
    if limit is not None:
        (tmp_path / "limit").write_text(limit)
    monkeypatch.setattr(machine, "CONTAINER_LIMIT", tmp_path / "limit")
    assert machine.total_memory_bytes() == (total or os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


@pytest.mark.parametrize(
    ("text", "free"),
    [("MemTotal: 9 kB\nMemAvailable:   2000 kB\n", 2_048_000), ("MemTotal: 9 kB\n", None), ("?", None)],
)
def test_free_memory_is_what_the_system_calls_available(monkeypatch, tmp_path, text, free):
    (tmp_path / "facts").write_text(text)
    monkeypatch.setattr(machine, "MEMORY_FACTS", tmp_path / "facts")
    assert machine.free_memory_bytes() == free
