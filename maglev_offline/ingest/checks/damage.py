"""Damage of the files' bytes, told as findings."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from maglev_offline.ingest import rules
from maglev_offline.ingest.findings import MOST_PLACES, Finding, Place, Severity
from maglev_offline.logs.structure import DAMAGES, Damage

if TYPE_CHECKING:
    from maglev_offline.ingest.decoded import DecodedLog, Part

_HARMLESS = frozenset(
    {"trailing_bytes", "summary_unusable", "record_length_mismatch", "message_index_mismatch", "no_footer"}
)
"""Nothing was lost to these."""


def damage_findings(log: str, parts: "Sequence[Part]", decoded: "DecodedLog") -> list[Finding]:
    """One finding for each kind of damage in each file: what was lost, where, and what to do."""
    found = []
    for number, part in enumerate(parts):
        kinds: dict[str, list[Damage]] = {}
        for at, damage in decoded.damages:
            if at == number:
                kinds.setdefault(damage.code, []).append(damage)
        for code, damages in sorted(kinds.items()):
            found.append(_finding(log, Path(str(part.where)).name, code, damages))
    missing = sum(lost.count for lost in decoded.lost if lost.code == rules.MISSING)
    if missing:
        found.append(
            Finding(
                code="messages_missing",
                severity="error",
                about="recording",
                log=log,
                topic="",
                point="",
                what=f"The log's statistics count {missing:,} messages more than are in it.",
                todo="Copy the log again from the recorder.",
                numbers={"messages": missing},
            )
        )
    return found


def _finding(log: str, file: str, code: str, damages: Sequence[Damage]) -> Finding:
    counted = sum(sum(damage.messages.values()) for damage in damages if damage.messages is not None)
    unknown = sum(damage.messages is None for damage in damages)
    lost = f"{counted:,} messages were lost" if counted else "no message is known to be lost"
    if unknown:
        lost += f", and in {unknown:,} of {len(damages):,} places nobody knows how many"
    severity: Severity = "warning" if code in _HARMLESS and not counted and not unknown else "error"
    first = damages[0]
    return Finding(
        code=code,
        severity=severity,
        about="recording",
        log=log,
        topic="",
        point="",
        what=f"{DAMAGES.get(code, 'The file is damaged.')} {file}, byte {first.offset:,}: {first.detail}; {lost}.",
        todo="Copy the log again from the recorder if it is still there; what could be read was used.",
        numbers={"messages_lost": counted, "bytes": sum(damage.length for damage in damages)},
        count=len(damages),
        places=tuple(Place(byte_offset=d.offset, byte_length=d.length) for d in damages[:MOST_PLACES]),
    )
