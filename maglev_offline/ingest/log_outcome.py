"""What became of each log that was to be ingested, and how it is told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from maglev_offline.errors import InputError
from maglev_offline.filesystems import Where, name_of
from maglev_offline.ingest.request import Request

if TYPE_CHECKING:  # decoding is imported by those logs that are decoded
    from maglev_offline.ingest.log import IngestedLog

Status = Literal["ingested", "skipped", "refused", "duplicate", "not written"]


@dataclass(frozen=True)
class LogOutcome:
    """What became of one log; `message` is the paragraph for a user, `folder` the artefact (None if refused).

    `counts` and `left_out` are those of the manifest, empty for a refused log and for a duplicate.
    """

    path: Where
    log_id: str
    status: Status
    counts: dict[str, int]
    left_out: dict[str, int]
    message: str
    folder: Path | None

    @property
    def name(self) -> str:
        """File name, for people."""
        return name_of(self.path)


@dataclass(frozen=True)
class IngestResult:
    """What became of each log, in order of their names."""

    logs: tuple[LogOutcome, ...]

    @property
    def folders(self) -> tuple[Path, ...]:
        """The artefacts of these logs, each once; what the next stage reads."""
        return tuple(dict.fromkeys(log.folder for log in self.logs if log.folder is not None))

    @property
    def refused(self) -> tuple[LogOutcome, ...]:
        """The logs that could not be used."""
        return tuple(log for log in self.logs if log.status == "refused")


def refused(where: Where, error: InputError, log_id: str = "") -> LogOutcome:
    """The outcome of a log that cannot be used."""
    return LogOutcome(where, log_id or name_of(where).removesuffix(".mcap"), "refused", {}, {}, error.paragraph(), None)


def sentence(made: IngestedLog, request: Request) -> str:
    """What a log became."""
    counts = made.counts
    text = (
        f"{counts['messages_used']:,} of {counts['messages']:,} messages became {counts['rows']:,} samples of "
        f"{counts['points']} point{'s' * (counts['points'] != 1)} in {counts['segments']:,} "
        f"segment{'s' * (counts['segments'] != 1)}."
    )
    told = made.facts["findings"]
    if told["error"] or told["warning"]:
        text += f" {told['error']} errors and {told['warning']} warnings: see `maglev-offline inspect`."
    grid_ms = request.settings.grid_ms
    period_ms = min(
        (topic["period_ms"] for topic in made.facts["topics"].values() if topic["period_ms"]), default=grid_ms
    )
    if period_ms < grid_ms / 1.5:
        text += f" The messages come every {period_ms:g} ms: [ingest] grid_ms = {grid_ms:g} thins them out."
    return text
