"""How many messages each channel has, without decoding any, and how that fits what the log claims."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.chunks import LARGEST_CHUNK_BYTES, load_span
from maglev_offline.logs.message_index import parse_index, sound_counts
from maglev_offline.logs.source import Source
from maglev_offline.logs.structure import ChunkSpan, Damage, Span, Structure


class ChannelCount(NamedTuple):
    """How many messages one channel has, and their earliest and latest log time."""

    messages: int
    first_ns: int
    last_ns: int


class Shortfall(NamedTuple):
    """Messages by channel id that the log claims and nobody found, beyond those that damages are known to have taken.

    `in_damage` are those that may have lain in a damage of unknown content; `unexplained` those that cannot have.
    `surplus` are messages that were found beyond what is claimed.
    """

    in_damage: dict[int, int]
    unexplained: dict[int, int]
    surplus: dict[int, int]


def count_messages(source: Source, structure: Structure) -> dict[int, ChannelCount]:
    """Messages by channel id: from the index of a chunk, in one read for each; by reading the span where it has none.

    What is found only by reading a chunk, a wrong check sum above all, is not found here.
    """
    totals: dict[int, ChannelCount] = {}
    for span in structure.spans:
        channel_id, log_time_ns = _times(source, span, structure)
        _add(totals, channel_id, log_time_ns)
    return dict(sorted(totals.items()))


def _times(source: Source, span: Span, structure: Structure) -> tuple[NDArray[np.uint16], NDArray[np.uint64]]:
    if isinstance(span, ChunkSpan) and 0 < span.index_length <= LARGEST_CHUNK_BYTES:
        entries = parse_index(source.read_at(span.index_offset, span.index_length))
        if entries is not None and sound_counts(entries, 2**62) is not None:
            if entries.counts().keys() <= structure.channels.keys():
                return entries.channel_id, entries.log_time_ns
            known = np.isin(entries.channel_id, list(structure.channels))
            return entries.channel_id[known], entries.log_time_ns[known]
    table = load_span(source, span, structure.channels).messages
    return table.channel_id, table.log_time_ns


_MOST_STRETCHES = 1000
"""More stretches of one channel are sorted together first."""


def _add(totals: dict[int, ChannelCount], channel_id: NDArray[np.uint16], log_time_ns: NDArray[np.uint64]) -> None:
    if not len(channel_id):
        return
    ids, times = channel_id, log_time_ns
    starts = np.flatnonzero(np.append(True, ids[1:] != ids[:-1]))
    if len(starts) > _MOST_STRETCHES:  # an index has its channels one after the other; messages in file order do not
        order = np.argsort(channel_id, kind="stable")
        ids, times = channel_id[order], log_time_ns[order]
        starts = np.flatnonzero(np.append(True, ids[1:] != ids[:-1]))
    counts = np.diff(np.append(starts, len(ids)))
    earliest, latest = np.minimum.reduceat(times, starts), np.maximum.reduceat(times, starts)
    for number, n, first, last in zip(
        ids[starts].tolist(), counts.tolist(), earliest.tolist(), latest.tolist(), strict=True
    ):
        before = totals.get(number, ChannelCount(0, first, last))
        totals[number] = ChannelCount(before.messages + n, min(before.first_ns, first), max(before.last_ns, last))


def shortfall(claimed: Mapping[int, int] | None, found: Mapping[int, int], damages: Iterable[Damage]) -> Shortfall:
    """Hold what was found against what the Statistics record claims (None: it claims nothing).

    Parameters
    ----------
    found: messages by channel id that were read; damages: all of the structure and of the spans.
    """
    if claimed is None:
        return Shortfall({}, {}, {})
    lost: Counter[int] = Counter()
    unknown = False
    for damage in damages:
        unknown |= damage.messages is None
        lost.update(damage.messages or {})
    gap = {k: claimed.get(k, 0) - found.get(k, 0) - lost[k] for k in sorted({*claimed, *found})}
    missing = {k: n for k, n in gap.items() if n > 0}
    surplus = {k: -n for k, n in gap.items() if n < 0}
    return Shortfall(missing, {}, surplus) if unknown else Shortfall({}, missing, surplus)
