"""What the stages have to tell when they are done: numbers for scripts, sentences and tables for people."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from maglev_offline.ingest.log_outcome import LogOutcome

LOG_COLUMNS = ("log", "status", "messages", "used", "quarantined", "samples", "segments")
MOST_UNCHANGED_ROWS = 20
"""Of more logs than these, the unchanged ones are told in one line: a table of a thousand takes a second to lay out."""

_LOG_COUNTS = ("messages", "messages_used", "messages_quarantined", "rows", "segments")


@dataclass
class Done:
    """What a stage has to tell: an artefact, its numbers for scripts, a sentence and a table for people."""

    stage: str
    artefact: Path
    fresh: bool
    sentence: str
    data: dict[str, Any] = field(default_factory=dict)
    title: str = ""
    columns: tuple[str, ...] = ()
    rows: list[list[str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """Further sentences, a line each."""

    def plain(self) -> dict[str, Any]:
        """For scripts."""
        status = "done" if self.fresh else "unchanged"
        return {"stage": self.stage, "status": status, "artefact": str(self.artefact), **self.data}

    def lines(self) -> list[str]:
        """For people."""
        note = "" if self.fresh else " (unchanged inputs and recipe: nothing was done)"
        return [f"{self.stage}: {self.sentence}{note}", *(f"  {text}" for text in self.notes), f"  -> {self.artefact}"]


@dataclass
class Ingested:
    """What `ingest` has to tell: one outcome for each log, and what `curate` made of all of them."""

    logs: list[LogOutcome]
    transitions: Done | None

    @property
    def refused(self) -> list[LogOutcome]:
        """The logs that could not be used."""
        return [log for log in self.logs if log.status == "refused"]

    def rows(self) -> list[list[str]]:
        """One row of `LOG_COLUMNS` for each log; of many, those that were there already, unchanged, have none."""
        many = len(self.logs) > MOST_UNCHANGED_ROWS
        return [
            [log.name, log.status, *(f"{log.counts[key]:,}" if key in log.counts else "-" for key in _LOG_COUNTS)]
            for log in self.logs
            if not (many and log.status == "skipped")
        ]

    def plain(self) -> dict[str, Any]:
        """For scripts."""
        return {
            "stage": "ingest",
            "status": "refused" if self.refused else "done",
            "logs": [
                {
                    "file": str(log.path),
                    "log_id": log.log_id,
                    "status": log.status,
                    "counts": log.counts,
                    "left_out": log.left_out,
                    "message": log.message,
                    "artefact": None if log.folder is None else str(log.folder),
                }
                for log in self.logs
            ],
            "transitions": self.transitions.plain() if self.transitions else None,
        }

    def lines(self) -> list[str]:
        """For people."""
        return [] if self.transitions is None else self.transitions.lines()


@dataclass
class Run:
    """What the whole road has to tell."""

    ingested: Ingested
    stages: list[Done]

    @property
    def refused(self) -> list[LogOutcome]:
        """The logs that could not be used."""
        return self.ingested.refused

    def plain(self) -> dict[str, Any]:
        """For scripts."""
        return {
            "stage": "run",
            "status": "refused" if self.refused else "done",
            "ingest": self.ingested.plain(),
            "stages": [done.plain() for done in self.stages],
            "report": str(self.stages[-1].artefact) if self.stages else None,
        }

    def lines(self) -> list[str]:
        """For people."""
        if not self.stages:
            return ["None of the logs could be used: there is nothing to go on with."]
        return ["", f"The report: {self.stages[-1].artefact}"]
