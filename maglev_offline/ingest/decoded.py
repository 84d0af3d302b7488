"""A log, or several files that are one recording, decoded: slabs of columns, and a count of all that came in."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from maglev_offline.filesystems import Where
from maglev_offline.ingest import rules
from maglev_offline.logs.channels import LogInfo, read_survey
from maglev_offline.logs.counts import shortfall
from maglev_offline.logs.gathering import Gathering
from maglev_offline.logs.reader import ReadRun, TopicWanted, read_run, runs
from maglev_offline.logs.slabs import Slab, bytes_of_row
from maglev_offline.logs.source import open_source
from maglev_offline.logs.structure import Damage, Span, Structure
from maglev_offline.progress import SILENT, Progress
from maglev_offline.spread import spread

IN_MEMORY_BYTES = 64 * 2**20
"""Decoded messages of a log are held in memory up to so many bytes; those of a larger one wait on disk."""


@dataclass(frozen=True)
class Part:
    """One file of a recording: where it is, what it says of itself, and where everything lies in it."""

    where: Where
    info: LogInfo
    structure: Structure


@dataclass(frozen=True)
class Lost:
    """Messages of one topic that the file had and that could not be read: how many, why, and where in which file."""

    topic: str
    code: str
    count: int
    detail: str
    byte_offset: int


@dataclass(frozen=True)
class DecodedLog:
    """Decoded columns of the wanted topics, and what came in.

    `slabs` in the order of the file, each with the number of messages that it spans. `found` counts messages of every
    topic that could be read, `lost` those that could not. `damages` are of the files' bytes, with the number of the
    part.
    """

    slabs: tuple[tuple[Slab, int], ...]
    found: dict[str, int]
    lost: tuple[Lost, ...]
    rungs: dict[str, int]
    failures: dict[str, str]
    damages: tuple[tuple[int, Damage], ...]


def open_parts(where: Sequence[Where]) -> list[Part]:
    """Survey each file; LogError where one is no MCAP file."""
    parts = []
    for one in where:
        with open_source(one) as source:
            parts.append(Part(one, *read_survey(source)))
    return parts


def decode_parts(
    parts: Sequence[Part],
    wanted: Mapping[str, TopicWanted],
    scratch: Path,
    *,
    jobs: int = 1,
    progress: Progress = SILENT,
) -> DecodedLog:
    """Decode the wanted topics of all parts, one after the other; `scratch` is a folder for what memory cannot hold.

    The number of `jobs` changes nothing but the time.

    Raises
    ------
    LogError: a wanted topic cannot be decoded at all.
    """
    work = [(number, part, spans) for number, part in enumerate(parts) for spans in runs(part.structure)]
    size = sum(span.length for _, _, spans in work for span in spans)
    slabs: list[tuple[Slab, int]] = []
    found: Counter[str] = Counter()
    by_part: list[Counter[int]] = [Counter() for _ in parts]
    rungs: Counter[str] = Counter()
    failures: dict[str, str] = {}
    damages = [(number, damage) for number, part in enumerate(parts) for damage in part.structure.damages]
    with progress.task(f"decode {Path(str(parts[0].where)).name}", round(size / 1e6), "MB") as tick:
        for (number, _, spans), read in zip(work, _reads(work, wanted, scratch, jobs), strict=True):
            slabs += read.slabs
            by_part[number].update(read.counts)
            rungs.update(read.rungs)
            failures |= {topic: text for topic, text in read.failures.items() if topic not in failures}
            damages += [(number, damage) for damage in read.damages]
            tick(round(sum(span.length for span in spans) / 1e6))
    lost: list[Lost] = []
    told: list[tuple[int, Damage]] = []
    for number, part in enumerate(parts):
        for channel_id, count in by_part[number].items():
            found[part.structure.channels[channel_id].topic] += count
        own = _believable(part.structure.claimed, by_part[number], [d for at, d in damages if at == number])
        lost += _lost(part.structure, by_part[number], own)
        told += [(number, damage) for damage in own]
    return DecodedLog(tuple(slabs), dict(sorted(found.items())), tuple(lost), dict(rungs), failures, tuple(told))


_Work = tuple[int, Part, tuple[Span, ...]]


def _reads(work: Sequence[_Work], wanted: Mapping[str, TopicWanted], scratch: Path, jobs: int) -> Iterator[ReadRun]:
    if jobs > 1 and len(work) > 1:
        to = (scratch / f"{number}.slabs" for number in range(len(work)))
        yield from spread(
            _read, ((part, spans, wanted, path) for (_, part, spans), path in zip(work, to, strict=True)), jobs
        )
        return
    expected: Counter[str] = Counter()
    for part in {number: part for number, part, _ in work}.values():
        for channel in part.info.channels:
            expected[channel.topic] += channel.message_count
    size = sum(count * _row_bytes(wanted[topic]) for topic, count in expected.items() if topic in wanted)
    fits = size <= IN_MEMORY_BYTES
    gathering = Gathering({topic: expected[topic] for topic in wanted}, IN_MEMORY_BYTES) if fits else None
    held = 0
    for number, (_, part, spans) in enumerate(work):
        # An index may tell of fewer messages than there are.
        fits &= held <= 2 * IN_MEMORY_BYTES
        read = _read(part, spans, wanted, None if fits else scratch / f"{number}.slabs", gathering)
        held += sum(n * _row_bytes(wanted[topic]) for slab, _ in read.slabs for topic, n in slab.counts.items())
        yield read


def _row_bytes(wanted: TopicWanted) -> int:
    return bytes_of_row(4 if wanted.clock is None else 5, len(wanted.paths))


def _read(
    part: Part,
    spans: tuple[Span, ...],
    wanted: Mapping[str, TopicWanted],
    spill_to: Path | None,
    gathering: Gathering | None = None,
) -> ReadRun:
    with open_source(part.where) as source:
        return read_run(source, part.structure, spans, wanted, spill_to=spill_to, gathering=gathering)


def _believable(claimed: Mapping[int, int] | None, found: Mapping[int, int], damages: Sequence[Damage]) -> list[Damage]:
    """Damages that took no more messages of a channel than the statistics leave for them.

    What the content of a chunk with a wrong check sum tells of its messages may be wrong itself.
    """
    if claimed is None:
        return list(damages)
    taken: Counter[int] = Counter(found)
    for damage in damages:
        if damage.code != _CRC:
            taken.update(damage.messages or {})
    kept: list[Damage] = []
    for damage in damages:
        if damage.code == _CRC and damage.messages is not None:
            left = {k: min(n, max(claimed.get(k, 0) - taken[k], 0)) for k, n in damage.messages.items()}
            taken.update(left)
            damage = replace(damage, messages={k: n for k, n in left.items() if n})
        kept.append(damage)
    return kept


_CRC = "chunk_crc_mismatch"


def _lost(structure: Structure, found: Mapping[int, int], damages: Sequence[Damage]) -> Iterator[Lost]:
    """What is known to have been in the file and could not be read, by topic."""
    for damage in damages:
        for channel_id, count in sorted((damage.messages or {}).items()):
            if count:
                yield Lost(_topic(structure, channel_id), damage.code, count, damage.detail, damage.offset)
    missing = shortfall(structure.claimed, found, damages)
    where = next((damage.offset for damage in damages if damage.messages is None), -1)
    for channel_id, count in sorted((missing.in_damage | missing.unexplained).items()):
        detail = "counted by the log's statistics" + (", lost in the damage" if missing.in_damage else "")
        yield Lost(_topic(structure, channel_id), rules.MISSING, count, detail, where)


def _topic(structure: Structure, channel_id: int) -> str:
    channel = structure.channels.get(channel_id)
    return channel.topic if channel else f"(channel {channel_id})"
