"""A look at several logs: each by itself, what they share, and what it ends with."""

import numpy as np
import pytest

from maglev_offline.ingest.findings import Finding
from maglev_offline.ingest.inspect import inspect_log
from maglev_offline.ingest.inspect_many import ManyInspected, inspect_logs
from maglev_offline.ingest.request import Request
from maglev_offline.progress import SILENT


def finding(severity):
    return Finding("code", severity, "signal", "a.mcap", "/a", "A", "what", "todo")


@pytest.fixture
def logs(tmp_path, write_log):
    """Write logs of drives that differ by their seed, by path below the folder."""

    def write(**seeds):
        paths = []
        for name, seed in seeds.items():
            path = tmp_path / f"{name.replace('__', '/')}.mcap"
            path.parent.mkdir(exist_ok=True)
            gap = 8 + np.random.default_rng(seed).normal(size=200) / 10
            paths.append(write_log(path, 100 * np.arange(200), gap))
        return paths

    return write


class Ticks:
    """A progress that notes what is told, in order."""

    def __init__(self):
        self.told = []

    def __getattr__(self, name):
        return getattr(SILENT, name)

    def error(self, text):
        self.told.append(text)

    def task(self, title, total, unit):
        return self

    def __enter__(self):
        return lambda more: self.told.append(more)

    def __exit__(self, *_):
        return None


def test_each_is_looked_at_as_if_it_were_alone(logs):
    paths = logs(a=1, b=2)
    many = inspect_logs(paths, Request())
    alone = [inspect_log(path, Request()) for path in paths]
    assert [(one.summary, one.findings) for one in many.logs] == [(one.summary, one.findings) for one in alone]
    assert many.across == ()


def test_several_processes_find_the_same_in_the_same_order(logs):
    paths = logs(a=1, b=2, c=1)
    one, two = (inspect_logs(paths, Request(), jobs=jobs) for jobs in (1, 2))
    assert [log.summary for log in one.logs] == [log.summary for log in two.logs]
    assert one.findings == two.findings
    assert one.across == two.across


def test_what_they_share_is_told_across_them(logs):
    across = inspect_logs(logs(a=1, b=2, c=1), Request()).across
    assert {(one.code, one.log) for one in across} == {("duplicate_content", "a.mcap"), ("duplicate_content", "c.mcap")}


def test_logs_of_one_name_are_told_apart_by_their_paths(logs):
    paths = logs(x__a=1, y__a=1, y__b=2)
    assert {one.log for one in inspect_logs(paths, Request()).across} == {str(path) for path in paths[:2]}


def test_one_that_cannot_be_read_is_refused_and_the_others_go_on(logs, tmp_path):
    (tmp_path / "bad.mcap").write_text("no MCAP")
    a, b = logs(a=1, b=2)
    many = inspect_logs([a, tmp_path / "bad.mcap", b], Request())
    assert [one.summary.file for one in many.logs] == ["a.mcap", "b.mcap"]
    (refused,) = many.refused
    assert "bad.mcap" in refused.where


def test_progress_is_told_log_by_log(logs, tmp_path):
    (tmp_path / "bad.mcap").write_text("no MCAP")
    progress = Ticks()
    inspect_logs([*logs(a=1), tmp_path / "bad.mcap", *logs(b=2)], Request(), progress=progress)
    first, second, told, third = progress.told
    assert (first, second, third) == (1, 1, 1)
    assert "bad.mcap" in told


def test_the_first_is_told_before_the_last_is_looked_at(logs, monkeypatch):
    seen = []

    def look(where, *_, **__):
        seen.append(where.name)
        return inspect_log(where, Request())

    monkeypatch.setattr("maglev_offline.ingest.inspect_many.inspect_log", look)
    progress = Ticks()
    progress.told = seen
    inspect_logs(logs(a=1, b=2), Request(), progress=progress)
    assert seen == ["a.mcap", 1, "b.mcap", 1]


@pytest.mark.parametrize(
    ("severities", "worst", "codes"),
    [
        ((), "", (0, 0, 0, 0)),
        (("info",), "info", (0, 1, 0, 0)),
        (("info", "warning"), "warning", (0, 1, 1, 0)),
        (("error", "info"), "error", (0, 2, 2, 2)),
    ],
)
def test_it_ends_by_the_worst_of_all_findings(severities, worst, codes):
    many = ManyInspected((), (), tuple(finding(severity) for severity in severities))
    assert many.worst == worst
    assert tuple(many.exit_code(least) for least in ("never", "info", "warning", "error")) == codes
