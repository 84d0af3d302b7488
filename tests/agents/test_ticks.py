import os

import pytest

from maglev_offline.agents.ticks import FileTicker, Orphaned, tick_file


def test_what_is_counted_in_the_file_arrives_whole():
    heard = []
    with tick_file(heard.append) as tick:
        for done in (3, 5, 2**40):
            tick(done)
        path = tick.path
    assert heard == [3, 5, 2**40]
    assert not path.exists()


def test_a_worker_whose_command_is_gone_stops(tmp_path):
    gone = os.spawnlp(os.P_NOWAIT, "true", "true")
    os.waitpid(gone, 0)
    with pytest.raises(Orphaned, match=str(gone)):
        FileTicker(tmp_path / "ticks", gone)(1)


@pytest.mark.parametrize("owner", [os.getpid(), os.getppid()], ids=["itself", "parent"])
def test_a_command_and_its_worker_count(tmp_path, owner):
    FileTicker(tmp_path / "ticks", owner)(1)
    assert (tmp_path / "ticks").stat().st_size == 8
