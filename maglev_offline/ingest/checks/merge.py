"""Findings of consecutive windows of a log become one for each code, topic, point and signal."""

from collections.abc import Iterable

from maglev_offline.ingest.checks.codes import CODES, make
from maglev_offline.ingest.findings import MOST_PLACES, SEVERITIES, Finding

_ADDED = ("messages", "missing", "of")

_TOLD_APART = ("signal", "limit", "clocks")
"""Findings of one code that differ in these numbers stay apart."""


def merge(findings: Iterable[Finding]) -> list[Finding]:
    """Join findings of one kind: counts add, places follow each other, numbers are joined by what they are.

    `messages`, `missing` and `of` add; `largest*`, `longest*` and `high_*` take the greatest; `smallest*` and `low_*`
    the least; words keep the first; all other numbers are means, weighted with `of`. The severity is the highest.
    A share is one of the windows in which there was something to find.
    """
    kinds: dict[tuple[str, ...], list[Finding]] = {}
    for found in findings:
        parts = (str(found.numbers.get(part, "")) for part in _TOLD_APART)
        key = (found.code, found.log, found.topic, found.point, *parts)
        kinds.setdefault(key, []).append(found)
    merged: list[Finding] = []
    for same in kinds.values():
        # Findings that are no check's, such as damage of the file, have words of their own and stay as they are.
        merged += same if len(same) == 1 or same[0].code not in CODES else [_joined(same)]
    return merged


def _joined(same: list[Finding]) -> Finding:
    head = same[0]
    names = dict.fromkeys(name for found in same for name in found.numbers)
    numbers = {name: _number(name, [found for found in same if name in found.numbers]) for name in names}
    places = [place for found in same for place in found.places]
    return make(
        head.code,
        head.log,
        head.topic,
        head.point,
        numbers,
        places=places[:MOST_PLACES],
        count=sum(found.count for found in same),
        severity=max((found.severity for found in same), key=SEVERITIES.index),
    )


def _number(name: str, having: list[Finding]) -> float | int | str:
    values = [found.numbers[name] for found in having]
    if isinstance(values[0], str):
        return values[0]
    numbers = [value for value in values if not isinstance(value, str)]
    if name in _ADDED:
        return sum(numbers)
    if name.startswith(("largest", "longest", "high_")):
        return max(numbers)
    if name.startswith(("smallest", "low_")):
        return min(numbers)
    if all(isinstance(value, int) for value in numbers) and len(set(numbers)) == 1:
        return numbers[0]
    weights = [_weight(found) for found in having]
    return sum(w * x for w, x in zip(weights, numbers, strict=True)) / sum(weights)


def _weight(found: Finding) -> float:
    of = found.numbers.get("of", found.count)
    return max(float(of), 1.0) if not isinstance(of, str) else 1.0
