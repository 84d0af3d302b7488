"""Several files that are one recording: in which order they are read, and whether they can be one at all."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from maglev_offline.errors import InputError


@dataclass(frozen=True)
class Part:
    """One file of a recording: its name for people, and of each topic with messages the first and last log time, ns.

    Where only the times of the whole file are known, give them for each of its topics.
    """

    name: str
    topics: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    @property
    def first_ns(self) -> int | None:
        """First log time of any topic; None where there are no messages."""
        return min((first for first, _ in self.topics.values()), default=None)


def merge_order(parts: Iterable[Part]) -> list[Part]:
    """Order the parts by their first time, then by name; parts without messages come last.

    Two parts may meet in one instant (a recorder that begins a new file), and topics of one part may run beside other
    topics of another.

    Raises
    ------
    InputError: two parts overlap in time on one topic, or one is named twice.
    """
    ordered = sorted(parts, key=lambda part: (part.first_ns is None, part.first_ns or 0, part.name))
    twice = sorted(name for name, times in Counter(part.name for part in ordered).items() if times > 1)
    if twice:
        raise InputError("it is named twice.", where=twice[0], todo="Name each part of a recording once.")
    for topic in sorted({topic for part in ordered for topic in part.topics}):
        _refuse_overlap(topic, [part for part in ordered if topic in part.topics])
    return ordered


def _refuse_overlap(topic: str, parts: Sequence[Part]) -> None:
    by_time = sorted(parts, key=lambda part: (*part.topics[topic], part.name))
    latest: Part | None = None
    for part in by_time:
        first, last = part.topics[topic]
        if latest is not None and first < latest.topics[topic][1]:
            overlap_ns = min(last, latest.topics[topic][1]) - first
            raise InputError(
                f"it overlaps with {latest.name} for {overlap_ns / 1e9:.3f} s on {topic}, so they are not parts of one "
                "recording.",
                where=part.name,
                todo="Leave one of them out, or ingest them without --merge.",
            )
        if latest is None or last >= latest.topics[topic][1]:
            latest = part


def merged_sha256(in_order: Iterable[str]) -> str:
    """Hash that stands for a recording of several files: that of their hashes, in the order in which they are read."""
    return hashlib.sha256("\n".join(["merged", *in_order]).encode()).hexdigest()
