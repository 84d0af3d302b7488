"""What the checks have to say of a log: a finding has a stable code, a severity, a place, numbers, and what to do."""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

Severity = Literal["info", "warning", "error"]

SEVERITIES: tuple[Severity, ...] = ("info", "warning", "error")
"""In rising order."""


@dataclass(frozen=True)
class Place:
    """A stretch of a topic or point: first and last time (ns since the epoch), first and last message in file order.

    `byte_offset` and `byte_length` are given where the finding is one of the file's bytes.
    """

    start_ns: int | None = None
    end_ns: int | None = None
    first_message: int | None = None
    last_message: int | None = None
    byte_offset: int | None = None
    byte_length: int | None = None


@dataclass(frozen=True)
class Finding:
    """One finding of one check. `code` never changes its meaning; `what` and `todo` are for people.

    `about` is `recording` for what is wrong with how the log was recorded, `signal` for what is wrong with a signal's
    values, and `use` for what limits what the log can teach though nothing is wrong with it. `count` is how many
    places there are; `places` holds the first of them.
    """

    code: str
    severity: Severity
    about: Literal["recording", "signal", "use"]
    log: str
    topic: str
    point: str
    what: str
    todo: str
    numbers: Mapping[str, float | int | str] = field(default_factory=dict)
    count: int = 1
    places: tuple[Place, ...] = ()

    def plain(self) -> dict[str, Any]:
        """For scripts: JSON-able."""
        return {
            "code": self.code,
            "severity": self.severity,
            "about": self.about,
            "log": self.log,
            "topic": self.topic,
            "point": self.point,
            "what": self.what,
            "todo": self.todo,
            "numbers": dict(self.numbers),
            "count": self.count,
            "places": [{k: v for k, v in vars(place).items() if v is not None} for place in self.places],
        }


MOST_PLACES = 100
"""A finding lists at most so many of its places."""

FINDINGS = "findings.json"
"""The file of an artefact that holds the findings of its log."""


def by_severity(findings: Iterable[Finding]) -> list[Finding]:
    """The worst first, then by log, code, topic and point."""
    return sorted(findings, key=lambda f: (-SEVERITIES.index(f.severity), f.log, f.code, f.topic, f.point))


def save_findings(findings: Iterable[Finding], path: Path) -> None:
    """Write findings as JSON, a NaN or an infinite number as null."""
    plain = [finding.plain() for finding in findings]
    for one in plain:
        numbers = one["numbers"].items()
        one["numbers"] = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in numbers}
    path.write_text(json.dumps(plain, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def load_findings(path: Path) -> list[Finding]:
    """Read findings that `save_findings` wrote."""
    plain = json.loads(path.read_text(encoding="utf-8"))
    return [Finding(**{**one, "places": tuple(Place(**place) for place in one["places"])}) for one in plain]
