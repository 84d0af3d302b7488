"""How a stage tells what it is doing, without knowing who listens."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


class Ticker(Protocol):
    """Counts the done part of one long task."""

    def __call__(self, done: int, /) -> None:
        """Add `done` units to the task."""


class Progress(Protocol):
    """What a stage may say: a line, a warning, an error that it survives, or the ticking of a long task."""

    def say(self, text: str) -> None:
        """Tell a fact."""

    def warn(self, text: str) -> None:
        """Tell something that the user should look at."""

    def error(self, text: str) -> None:
        """Tell that something could not be used, while the rest goes on."""

    def task(self, title: str, total: int, unit: str) -> AbstractContextManager[Ticker]:
        """Open a long task of `total` units."""


class Silent:
    """Listens to nothing; the default of every stage, and of tests."""

    def say(self, text: str) -> None:
        """Drop the line."""

    def warn(self, text: str) -> None:
        """Drop the warning."""

    def error(self, text: str) -> None:
        """Drop the error."""

    def task(self, title: str, total: int, unit: str) -> AbstractContextManager[Ticker]:  # noqa: ARG002
        """Return a ticker that counts nothing."""
        return _silent_task()


@contextmanager
def _silent_task() -> Iterator[Ticker]:
    yield lambda done: None  # noqa: ARG005


SILENT = Silent()
