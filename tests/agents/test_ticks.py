import fcntl
import re
import subprocess
import sys

import pytest

from maglev_offline.agents.ticks import OWNER, FileTicker, Orphaned, tick_files


def test_what_is_counted_in_the_files_arrives_whole():
    heard = []
    with tick_files(heard.append) as tick:
        for done in (3, 5, 2**40):
            tick(done)
    assert heard == [3, 5, 2**40]
    assert not tick.folder.exists()


def test_each_process_counts_into_a_file_of_its_own_in_a_folder_that_a_cluster_sees(tmp_path):
    heard = []
    code = "import sys, pathlib, maglev_offline.agents.ticks as t; t.FileTicker(pathlib.Path(sys.argv[1]))(7)"
    with tick_files(heard.append, tmp_path) as tick:
        assert tick.folder.parent == tmp_path
        tick(3)
        assert re.fullmatch(r"\.ticks\.[0-9a-f]{8}\.draft", tick.folder.name), "a name that is swept away"
        subprocess.run([sys.executable, "-c", code, tick.folder], check=True)
        assert len([path for path in tick.folder.iterdir() if path.name != OWNER]) == 2
    assert sorted(heard) == [3, 7]
    assert list(tmp_path.iterdir()) == []


def test_a_worker_whose_command_is_done_stops():
    with tick_files(lambda _: None) as tick:
        pass
    with pytest.raises(Orphaned, match="is gone"):
        tick(1)


def test_a_worker_whose_command_was_killed_stops(tmp_path):
    owner = tmp_path / OWNER
    with owner.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        FileTicker(tmp_path)(1)
    with pytest.raises(Orphaned, match="is gone"):
        FileTicker(tmp_path)(1)
