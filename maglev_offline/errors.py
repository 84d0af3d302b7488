"""The few exceptions that a user meets. Each says what was wrong, where, and what to do next."""


class MaglevOfflineError(Exception):
    """A failure of ours that a user may see; the command line ends with exit code 1.

    Parameters
    ----------
    what: one sentence, what was wrong.
    where: the file, topic, table or row it was found in; may be empty.
    todo: one sentence, what the user can do next; may be empty.
    """

    exit_code = 1

    def __init__(self, what: str, *, where: str = "", todo: str = "") -> None:
        self.what, self.where, self.todo = what, where, todo
        super().__init__(self.paragraph())

    def paragraph(self) -> str:
        """The whole message as one paragraph: where, what, what to do."""
        head = f"{self.where}: {self.what}" if self.where else self.what
        return f"{head} {self.todo}".strip()

    def __reduce__(self) -> tuple[object, ...]:
        """Survive the way back from a worker process."""
        return _rebuild, (type(self), self.what, self.where, self.todo)


def _rebuild(kind: type[MaglevOfflineError], what: str, where: str, todo: str) -> MaglevOfflineError:
    return kind(what, where=where, todo=todo)


class InputError(MaglevOfflineError):
    """Bad input: the command line ends with exit code 2 and never shows a traceback."""

    exit_code = 2


class RecipeError(InputError):
    """A recipe that cannot be used: an unknown key, a wrong unit, a number out of its range."""


class LogError(InputError):
    """A log that cannot be used: no MCAP, truncated, empty, or without the signals that are needed."""


class ArtefactError(InputError):
    """An artefact that a stage needs is missing, damaged, or was made by another recipe."""


class WorkspaceLocked(MaglevOfflineError):
    """Another command is at work in the same workspace."""
