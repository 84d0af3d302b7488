"""The benchmark of a day: its logs are what the mcap package would write, and it says what it lost."""

import subprocess
import sys
from pathlib import Path

import ingest_logs
import load
import load_logs
import pytest
from mcap.reader import make_reader

pytestmark = pytest.mark.nightly

FOLDER = Path(__file__).parents[2] / "benchmarks"


def messages_of(path):
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        found = [(c.topic, m.log_time, m.publish_time, m.sequence, m.data) for _, c, m in reader.iter_messages()]
        assert summary.statistics.message_count == len(found)
        return found


def test_its_logs_hold_the_messages_that_the_mcap_package_writes(tmp_path):
    ingest_logs.write_log(tmp_path / "a.mcap", "cdr", 700 * ingest_logs.POINTS)
    load_logs.write_day(tmp_path / "b.mcap", 700)
    assert messages_of(tmp_path / "b.mcap") == messages_of(tmp_path / "a.mcap")


def test_the_day_in_many_logs_is_the_day(tmp_path):
    load_logs.write_day(tmp_path / "whole.mcap", 30)
    for number in range(3):
        load_logs.write_day(tmp_path / f"{number}.mcap", 10, number * 10)
    stamps = [[m[2] for m in messages_of(tmp_path / f"{name}.mcap")] for name in ("whole", "0", "1", "2")]
    assert len(stamps[0]) == sum(map(len, stamps[1:]))
    assert max(stamps[1]) < min(stamps[2])


def test_a_row_that_takes_too_long_or_loses_a_message_is_named():
    good = {"logs": 1, "messages": 100, "jobs": 2, "whole": True, "times": 1.0, "memory": 1e9}
    assert load.complaints([good]) == []
    bad = [good | {"whole": False}, good | {"times": 1.4}, good | {"memory": 7e9}]
    said = load.complaints(bad)
    assert ["not every message" in said[0], "1.40 times" in said[1], "7,000 MB" in said[2]] == [True] * 3


def test_it_runs(tmp_path):
    command = [sys.executable, str(FOLDER / "load.py"), "--folder", str(tmp_path), "--share", "0.002", "--jobs", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.count("rows") >= 6, done.stderr
    assert "not every message" not in done.stdout
