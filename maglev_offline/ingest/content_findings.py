"""Shared content as findings, one for each of the two that share it, with its places."""

from collections.abc import Iterable
from typing import Literal

from maglev_offline.ingest.content_overlaps import Key, Overlap, Stretch
from maglev_offline.ingest.findings import MOST_PLACES, Finding, Place, Severity

_CODES: dict[str, tuple[str, Severity]] = {
    "identical": ("duplicate_content", "error"),
    "contained": ("contained_content", "error"),
    "partial": ("overlapping_content", "warning"),
}


def content_findings(overlaps: Iterable[Overlap]) -> list[Finding]:
    """Turn overlaps into findings, sorted by log and point.

    A log that repeats a part of itself gives one finding with the places of both. The numbers tell the rows (messages
    in order of time, from 0) of the longest stretch here and there.
    """
    found = []
    for overlap in overlaps:
        found.append(_finding(overlap, "a"))
        if overlap.a != overlap.b:
            found.append(_finding(overlap, "b"))
    return sorted(found, key=lambda f: (f.log, f.point, f.code, str(f.numbers["other_log"])))


def _finding(overlap: Overlap, side: Literal["a", "b"]) -> Finding:
    code, severity = _CODES[overlap.kind]
    (log, point), other = (overlap.a, overlap.b) if side == "a" else (overlap.b, overlap.a)
    share = overlap.share_of_a if side == "a" else overlap.share_of_b
    longest = max(overlap.stretches, key=lambda stretch: stretch.last_a - stretch.first_a)
    mine, theirs = (longest[:2], longest[2:4]) if side == "a" else (longest[2:4], longest[:2])
    itself = overlap.a == overlap.b
    places = [_place(stretch, side) for stretch in overlap.stretches]
    if itself:
        places = [place for stretch in overlap.stretches for place in (_place(stretch, "b"), _place(stretch, "a"))]
    return Finding(
        code=code,
        severity=severity,
        about="recording",
        log=log,
        topic="",
        point=point,
        what=_what(overlap, side, other, share),
        todo=_todo(overlap, side, other),
        numbers={
            "share": round(share, 4),
            "stretches": len(overlap.stretches),
            "first_row": mine[0],
            "last_row": mine[1],
            "other_log": other[0],
            "other_point": other[1],
            "other_first_row": theirs[0],
            "other_last_row": theirs[1],
        },
        count=len(places),
        places=tuple(places[:MOST_PLACES]),
    )


def _what(overlap: Overlap, side: str, other: Key, share: float) -> str:
    name = f"point {other[1]} of {other[0]}"
    if overlap.kind == "identical":
        return f"The values are those of {name}, row for row."
    if overlap.a == overlap.b:
        return f"{share:.0%} of the rows come again later in the same log, value for value."
    if overlap.kind == "contained":
        return f"The values are a part of {name}." if side == "a" else f"The values of {name} are a part of these."
    return f"{share:.0%} of the rows are also in {name}, value for value."


def _todo(overlap: Overlap, side: str, other: Key) -> str:
    if overlap.a == overlap.b:
        return "Find out which of the two is the recording, and leave the other out by a time range."
    if overlap.kind == "partial":
        return "Keep both on one side of any split, or cut the shared part out of one by a time range."
    if side == "b" and overlap.kind == "contained":
        return (
            f"Keep this one and leave {other[0]} out: rows that are there twice weigh double and leak between splits."
        )
    return "Keep one of them: rows that are there twice weigh double and leak between splits."


def _place(stretch: Stretch, side: Literal["a", "b"]) -> Place:
    times = stretch.times_a if side == "a" else stretch.times_b
    if times is not None:
        return Place(start_ns=times[0], end_ns=times[1])
    first, last = stretch[:2] if side == "a" else stretch[2:4]
    return Place(first_message=first, last_message=last)
