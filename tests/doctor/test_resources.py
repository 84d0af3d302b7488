import shutil
from collections import namedtuple

import pytest

from maglev_offline.doctor import resources
from maglev_offline.doctor.resources import ROW_BYTES, Needs, disk, machine, needs
from maglev_offline.recipe import parse_recipe
from maglev_offline.replay.buffer import WIDTH

STUDY = parse_recipe({"training": {"seeds": 16, "block": 8, "steps": 500_000}}, "here")


def test_a_row_is_as_wide_as_those_of_the_buffer():
    assert ROW_BYTES == WIDTH * 4


def test_a_study_needs_room_for_the_rows_of_all_seeds_that_learn_at_once():
    one, two = needs(STUDY, 1), needs(STUDY, 2)
    rows = 8 * 500_000 * ROW_BYTES
    assert (two.disk_bytes - one.disk_bytes, two.memory_bytes - one.memory_bytes) == (rows, rows + 500_000_000)
    assert needs(STUDY, 1000) == needs(STUDY, 8)  # two algorithms, two arms, two blocks
    assert needs(None, 2).disk_bytes < one.disk_bytes


@pytest.mark.parametrize(("free", "state"), [(400, "ok"), (200, "note"), (90, "problem")])
def test_a_disk_is_judged_by_what_the_recipe_may_take(monkeypatch, tmp_path, free, state):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: namedtuple("Usage", "free")(free))
    check = disk(tmp_path, Needs(0, 100))
    assert (check.state, check.facts) == (state, {"free_bytes": free, "needed_bytes": 100})


@pytest.mark.parametrize(("total", "free", "state"), [(9, 5, "ok"), (9, 4, "note"), (9, None, "ok"), (4, None, "note")])
def test_too_little_memory_is_a_note_that_says_to_take_fewer_processes(monkeypatch, total, free, state):
    monkeypatch.setattr(resources, "total_memory_bytes", lambda: total)
    monkeypatch.setattr(resources, "free_memory_bytes", lambda: free)
    cores, memory = machine(Needs(5, 0))
    assert (cores.state, memory.state) == ("ok", state)
    assert memory.facts == {"total_bytes": total, "free_bytes": free, "needed_bytes": 5}
    assert ("--jobs" in memory.todo) == (state == "note")
