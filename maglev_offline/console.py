"""What a person or a script sees: lines, progress bars on a terminal, JSON where it was asked for."""

import json
import re
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any, TextIO

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from maglev_offline.errors import MaglevOfflineError
from maglev_offline.progress import Ticker

SECONDS_BETWEEN_LINES = 10.0
"""How often a long task speaks where there is no terminal."""

PLAIN_WIDTH = 120
"""Width of tables where there is no terminal."""


_CONTROLS = dict.fromkeys((*range(9), *range(11, 32), *range(127, 160)), "�")


def _console(file: TextIO) -> Console:
    width = None if file.isatty() else PLAIN_WIDTH
    return Console(file=file, highlight=False, emoji=False, soft_wrap=True, width=width)


def _plain(text: str) -> str:
    """Text as it is: names in a log are neither markup nor control sequences of the terminal."""
    return escape(text.translate(_CONTROLS))


class Talk:
    """The voice of the command line; also the `Progress` that the stages speak to.

    Results go to standard output; progress, remarks and errors go to standard error. `as_json`: standard output holds
    one JSON document and nothing else. `quiet`: no remarks, no progress. Without a terminal, a long task says a plain
    line now and then.
    """

    def __init__(self, *, as_json: bool = False, quiet: bool = False) -> None:
        self.as_json, self.quiet = as_json, quiet
        self._out = _console(sys.stdout)
        self._err = _console(sys.stderr)
        self._told: set[str] = set()

    def say(self, text: str) -> None:
        """Tell a fact that is not the result."""
        if not self.quiet:
            self._err.print(_plain(text))

    def warn(self, text: str) -> None:
        """Tell something that the user should look at; a quiet run tells it too."""
        self._err.print(f"[yellow]warning:[/] {_plain(text)}")

    def error(self, text: str) -> None:
        """Tell that something could not be used; a quiet run tells it too."""
        self._err.print(f"[bold red]error:[/] {_plain(self.once(text))}")

    def once(self, text: str) -> str:
        """Text whose lines after the first were not told before, else its first line: one cause, many logs.

        Lines that differ in their numbers alone are the same: logs differ in length.
        """
        head, _, rest = text.partition("\n")
        alike = re.sub(r"\d[\d,.]*", "0", rest)
        if alike in self._told:
            return f"{head} the same as above."
        if alike and not self.as_json:
            self._told.add(alike)
        return text

    def fail(self, error: MaglevOfflineError) -> None:
        """Tell an error as a paragraph."""
        self.error(error.paragraph())

    def result(self, data: Mapping[str, Any], *lines: str) -> None:
        """Give the result of a command: `data` to scripts, `lines` to people."""
        if self.as_json:
            self._out.file.write(json.dumps(data, indent=2, allow_nan=False) + "\n")
        self.lines(*lines)

    def lines(self, *lines: str) -> None:
        """Show lines of a result to people only."""
        if not self.as_json:
            for line in lines:
                self._out.print(_plain(line))

    def table(self, title: str, columns: list[str], rows: list[list[str]]) -> None:
        """Show a table to people; numbers are right-aligned. Scripts get theirs from `result`."""
        if self.as_json or not rows:
            return
        view = Table(title=_plain(title), title_justify="left", box=None, pad_edge=False)
        for number, name in enumerate(columns):
            view.add_column(name, justify="left" if number == 0 else "right", no_wrap=number == 0)
        for row in rows:
            view.add_row(*(_plain(cell) for cell in row))
        self._out.print(view)

    def task(self, title: str, total: int, unit: str) -> AbstractContextManager[Ticker]:
        """Show the way of a long task: a bar on a terminal, else a plain line now and then."""
        if self.quiet:
            return _mute()
        return _bar(self._err, title, total, unit) if self._err.is_terminal else self._lines(title, total, unit)

    @contextmanager
    def _lines(self, title: str, total: int, unit: str) -> Iterator[Ticker]:
        done, began = 0, time.monotonic()
        last = began

        def tick(more: int) -> None:
            nonlocal done, last
            done += more
            now = time.monotonic()
            if now - last >= SECONDS_BETWEEN_LINES:
                last = now
                share = f"{done / max(total, 1):.0%}{_pace(done, total, unit, now - began)}"
                self.say(f"{title}: {done:,} of {total:,} {unit} ({share})")

        yield tick


def _pace(done: int, total: int, unit: str, seconds: float) -> str:
    """Units per second and the time left, once there is something to tell it by."""
    if not done or seconds <= 0:
        return ""
    rate = done / seconds
    return f", {rate:,.3g} {unit}/s, {_clock((total - done) / rate)} left"


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(max(seconds, 0.0)), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


class _Rate(ProgressColumn):
    """Units per second."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """The rate of late, empty as long as there is none."""
        return Text(f"{task.speed:,.3g} {self._unit}/s" if task.speed else "", style="progress.data.speed")


@contextmanager
def _mute() -> Iterator[Ticker]:
    yield lambda done: None  # noqa: ARG005


@contextmanager
def _bar(console: Console, title: str, total: int, unit: str) -> Iterator[Ticker]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(unit), _Rate(unit))
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task(title, total=total)

        def tick(done: int) -> None:
            progress.advance(bar, done)

        yield tick
