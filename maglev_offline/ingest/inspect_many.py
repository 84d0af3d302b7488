"""A look at several logs, and at what they share."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from maglev_offline.errors import LogError
from maglev_offline.filesystems import Where
from maglev_offline.ingest.content_findings import content_findings
from maglev_offline.ingest.content_overlaps import overlaps
from maglev_offline.ingest.findings import SEVERITIES, Finding, by_severity
from maglev_offline.ingest.inspect import Inspected, inspect_log
from maglev_offline.ingest.request import Request
from maglev_offline.ingest.store import is_large
from maglev_offline.progress import SILENT, Progress
from maglev_offline.spread import spread


@dataclass(frozen=True)
class ManyInspected:
    """The logs that could be looked at, those that could not, and the findings that concern several of them."""

    logs: tuple[Inspected, ...]
    refused: tuple[LogError, ...]
    across: tuple[Finding, ...]

    @property
    def findings(self) -> list[Finding]:
        """All findings, the worst first."""
        return by_severity([*self.across, *(finding for log in self.logs for finding in log.findings)])

    @property
    def worst(self) -> str:
        """The highest severity that was found; empty without findings."""
        return max((f.severity for f in self.findings), key=SEVERITIES.index, default="")

    def exit_code(self, fail_on: str) -> int:
        """0 where nothing is as severe as `fail_on`, else 1 up to a warning and 2 for an error."""
        if not self.worst or fail_on == "never" or SEVERITIES.index(self.worst) < SEVERITIES.index(fail_on):
            return 0
        return 2 if self.worst == "error" else 1


def inspect_logs(
    logs: Sequence[Where], request: Request, *, jobs: int = 1, progress: Progress = SILENT
) -> ManyInspected:
    """Look at each log; one that cannot be read is refused in words, and the others go on."""
    found: list[Inspected] = []
    names: list[str] = []
    refused: list[LogError] = []
    with progress.task("inspect", len(logs), "logs") as tick:
        for where, one in zip(logs, _each(logs, request, jobs), strict=True):
            tick(1)
            if isinstance(one, LogError):
                progress.error(one.paragraph())
                refused.append(one)
            else:
                found.append(one)
                names.append(str(where).encode(errors="backslashreplace").decode())
    # Logs of one name in several folders are told apart by their paths.
    of_name = Counter(one.summary.file for one in found)
    names = [one.summary.file if of_name[one.summary.file] == 1 else w for w, one in zip(names, found, strict=True)]
    sketches = {
        (name, point): sketch for name, one in zip(names, found, strict=True) for point, sketch in one.content.items()
    }
    across = by_severity(content_findings(overlaps(sketches)))
    return ManyInspected(tuple(found), tuple(refused), tuple(across))


def _each(logs: Sequence[Where], request: Request, jobs: int) -> "Iterator[Inspected | LogError]":
    """In the order of the logs, each as soon as it is done."""
    if jobs == 1 or len(logs) == 1 or any(is_large(log) for log in logs):
        return (_one(log, request, jobs) for log in logs)
    return spread(_one, ((log, request, 1) for log in logs), jobs)


def _one(where: Where, request: Request, jobs: int) -> "Inspected | LogError":
    try:
        return inspect_log(where, request, jobs=jobs)
    except LogError as error:
        return error
