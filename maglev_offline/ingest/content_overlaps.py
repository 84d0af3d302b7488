"""Which logs share content: one join of all anchors, then stretches of them at one offset. No pass over pairs of logs.

Dropped messages shift the offset, so that a copy with losses shares several stretches. Stretches under `FEWEST_ROWS`
rows are taken for chance; a shared stretch of 200 rows of a long log goes unseen about once in 400.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.content import SHINGLE, ContentSketch, Hashes, Rows, is_sparse

Key = tuple[str, str]
"""Log and point."""

FEWEST_ROWS = 64
"""A shorter stretch is no finding."""
WHOLE_SHARE = 0.95
"""A log is contained in another if so much of it is found there; it need not be all, for the sake of lost messages."""

_FEWEST_ANCHORS = 4
_MOST_MISSED = 16  # anchors that a stretch may miss on end: two altered rows of a dense log, a lost hundred of a long
_MOST_SHARED = 64  # sketches or places that an anchor may be in to be paired with all of them
_MOST_PAIRS = 20_000_000  # bounds the memory
_MOST_STRETCHES = 100


class Stretch(NamedTuple):
    """Shared rows, from the first to the last, in the part `a` and in `b`; times are None where the sketch has none."""

    first_a: int
    last_a: int
    first_b: int
    last_b: int
    times_a: tuple[int, int] | None
    times_b: tuple[int, int] | None


@dataclass(frozen=True)
class Overlap:
    """Two points of logs, or one twice, that share content; `a` is the one with fewer rows.

    `kind`: the rows are identical; `a` is contained in `b`; or they share a part. The shares are those of the rows of
    each. `stretches` are in the order of the rows of `a`, at most the 100 longest; an identical pair has one.
    """

    kind: Literal["identical", "contained", "partial"]
    a: Key
    b: Key
    share_of_a: float
    share_of_b: float
    stretches: tuple[Stretch, ...]


def overlaps(sketches: Mapping[Key, ContentSketch]) -> list[Overlap]:
    """Find all that share content, in order of their keys; the order of `sketches` changes nothing.

    Of identical ones each is paired with the first by its key, and that one stands for all of them elsewhere. An
    anchor that is in very many places is paired with the longest log that has it only.
    """
    found: list[Overlap] = []
    first_of: dict[tuple[int, int], Key] = {}
    # The longest comes first, so that it is the `b` of its pairs and the partner of crowded anchors.
    for key in sorted(sketches, key=lambda k: (-sketches[k].rows, k)):
        sketch = sketches[key]
        if len(sketch.anchors) == 0:
            continue  # at rest all the time, or too short: nothing to tell it by
        first = first_of.setdefault((sketch.rows, sketch.whole), key)
        if first != key:
            found.append(_identical(key, first, sketch, sketches[first]))
    keys = list(first_of.values())
    if keys:
        kept = [sketches[key] for key in keys]
        table = _join_table(kept)
        found.extend(_overlap(pair, table, keys, kept) for pair in _by_pair(_stretches(_pairs(table), table)))
    return sorted(found, key=lambda overlap: (overlap.a, overlap.b))


def _identical(key: Key, first: Key, a: ContentSketch, b: ContentSketch) -> Overlap:
    last = a.rows - 1
    stretch = Stretch(0, last, 0, last, _times(a, 0, -1), _times(b, 0, -1))
    return Overlap("identical", key, first, 1.0, 1.0, (stretch,))


def _times(sketch: ContentSketch, first: int, last: int) -> tuple[int, int] | None:
    return None if sketch.t_ns is None else (int(sketch.t_ns[first]), int(sketch.t_ns[last]))


class _Anchors(NamedTuple):
    """All anchors in order of their hash, those of one hash by owner and row. `place` is the index within the owner's
    sketch, `sparse_place` that among its sparse anchors. By owner: `dense`, and how many anchors and sparse ones."""

    hash: Hashes
    owner: NDArray[np.int64]
    place: Rows
    sparse_place: Rows
    row: Rows
    dense: NDArray[np.bool_]
    anchors: Rows
    sparse_count: Rows


def _join_table(sketches: list[ContentSketch]) -> _Anchors:
    hashes = np.concatenate([sketch.anchors for sketch in sketches])
    sparse = [is_sparse(sketch.anchors) for sketch in sketches]
    order = np.argsort(hashes, kind="stable")
    count = np.array([len(sketch.anchors) for sketch in sketches])
    return _Anchors(
        hashes[order],
        np.repeat(np.arange(len(sketches)), count)[order],
        np.concatenate([np.arange(n) for n in count])[order],
        np.concatenate([np.cumsum(kept) - 1 for kept in sparse])[order],
        np.concatenate([sketch.position for sketch in sketches])[order],
        np.array([sketch.dense for sketch in sketches]),
        count,
        np.array([int(kept.sum()) for kept in sparse]),
    )


class _Pairs(NamedTuple):
    """Pairs of anchors of one hash, as indices into the table; the part `a` comes later in it than `b`."""

    a: NDArray[np.int64]
    b: NDArray[np.int64]


def _pairs(table: _Anchors) -> _Pairs:
    """Pair each anchor with every other of its hash, or with the first alone where there are too many."""
    starts = np.flatnonzero(np.concatenate([[True], table.hash[1:] != table.hash[:-1]]))
    sizes = np.diff(np.append(starts, len(table.hash)))
    shared = sizes > 1
    starts, sizes = starts[shared], sizes[shared]
    limit = _most_shared(sizes)
    lone = np.repeat(sizes > limit, sizes)  # entries of crowded groups
    begin = np.repeat(starts, sizes)
    rank = np.arange(len(begin)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    size = np.repeat(sizes, sizes)
    crowded = lone & (rank > 0)
    a, b = [(begin + rank)[crowded]], [begin[crowded]]
    here, left = (begin + rank)[~lone], (size - rank)[~lone]
    for lag in range(1, limit):
        here, left = here[left > lag], left[left > lag]
        a.append(here + lag)
        b.append(here)
    return _Pairs(np.concatenate(a), np.concatenate(b))


def _most_shared(sizes: NDArray[np.int64]) -> int:
    """Largest size of a group, up to `_MOST_SHARED`, for which all pairs of all groups up to it can be held."""
    groups = np.bincount(sizes[sizes <= _MOST_SHARED], minlength=_MOST_SHARED + 1)
    n = np.arange(_MOST_SHARED + 1)
    held = np.cumsum(groups * n * (n - 1) // 2) <= _MOST_PAIRS
    return int(np.flatnonzero(held)[-1])


class _Found(NamedTuple):
    """Stretches: owner and number of matched anchors, and where the first and last of them are in the table."""

    owner_a: NDArray[np.int64]
    owner_b: NDArray[np.int64]
    matched: NDArray[np.int64]
    first_a: NDArray[np.int64]
    last_a: NDArray[np.int64]
    first_b: NDArray[np.int64]
    last_b: NDArray[np.int64]


def _stretches(pairs: _Pairs, table: _Anchors) -> _Found:
    """Runs of pairs at one offset of rows without too many anchors of `a` missed between; by owners, longest first."""
    a, b = pairs
    owners = table.owner[b] * len(table.dense) + table.owner[a]
    offset = table.row[b] - table.row[a]
    order = np.lexsort((table.row[a], offset, owners))
    a, b, owners, offset = a[order], b[order], owners[order], offset[order]
    place = _place(table, a, b)
    breaks = (np.diff(owners) != 0) | (np.diff(offset) != 0) | (np.diff(place) > _MOST_MISSED + 1)
    first = np.flatnonzero(np.concatenate([[True], breaks])) if len(a) else np.empty(0, dtype=np.int64)
    last = np.append(first[1:], len(a)) - 1 if len(a) else first
    matched = last - first + 1
    rows = table.row[a[last]] - table.row[a[first]] + SHINGLE
    spanned = place[last] - place[first] + 1
    kept = (matched >= _FEWEST_ANCHORS) & (rows >= FEWEST_ROWS) & (2 * matched >= spanned)
    kept[kept] = _varied(table.hash[a], first[kept], last[kept])
    first, last, matched = first[kept], last[kept], matched[kept]
    order = np.lexsort((table.row[a[first]], -matched, owners[first]))
    first, last = first[order], last[order]
    return _Found(table.owner[a[first]], table.owner[b[first]], matched[order], a[first], a[last], b[first], b[last])


def _place(table: _Anchors, a: NDArray[np.int64], b: NDArray[np.int64]) -> Rows:
    """Index of an anchor of `a` among those that both could have."""
    both_dense = table.dense[table.owner[a]] & table.dense[table.owner[b]]
    return np.where(both_dense, table.place[a], table.sparse_place[a])


def _varied(hashes: Hashes, first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether a run holds enough different anchors: a signal that toggles between two values has but two."""
    length = last - first + 1
    run = np.repeat(np.arange(len(first)), length)
    inside = np.arange(len(run)) - np.repeat(np.cumsum(length) - length, length)
    values = hashes[np.repeat(first, length) + inside]
    order = np.lexsort((values, run))
    run, values = run[order], values[order]
    new = np.ones(len(run), dtype=np.bool_)
    new[1:] = (run[1:] != run[:-1]) | (values[1:] != values[:-1])
    varied: NDArray[np.bool_] = np.bincount(run[new], minlength=len(first)) >= _FEWEST_ANCHORS
    return varied


def _by_pair(found: _Found) -> Iterator[_Found]:
    """The stretches of each pair of sketches."""
    owners = np.stack([found.owner_a, found.owner_b])
    cuts = np.flatnonzero((owners[:, 1:] != owners[:, :-1]).any(axis=0)) + 1
    for start, stop in zip([0, *cuts], [*cuts, len(found.matched)], strict=True):
        if stop > start:
            yield _Found(*(column[start:stop] for column in found))


def _overlap(found: _Found, table: _Anchors, keys: list[Key], sketches: list[ContentSketch]) -> Overlap:
    a, b = int(found.owner_a[0]), int(found.owner_b[0])
    kept = _apart(table.row[found.first_a], table.row[found.last_a])
    matched = int(found.matched[kept].sum())
    both_dense = bool(table.dense[a] and table.dense[b])
    count = table.anchors if both_dense else table.sparse_count
    share_of_a, share_of_b = (min(matched / max(int(count[k]), 1), 1.0) for k in (a, b))
    listed = sorted(kept[:_MOST_STRETCHES], key=lambda k: int(table.row[found.first_a[k]]))
    stretches = tuple(
        Stretch(
            *_grown(found, table, k, int(count[a]), sketches[a].rows, sketches[b].rows),
            _times(sketches[a], int(table.place[found.first_a[k]]), int(table.place[found.last_a[k]])),
            _times(sketches[b], int(table.place[found.first_b[k]]), int(table.place[found.last_b[k]])),
        )
        for k in listed
    )
    contained = share_of_a >= WHOLE_SHARE and a != b
    return Overlap("contained" if contained else "partial", keys[a], keys[b], share_of_a, share_of_b, stretches)


def _apart(first: Rows, last: Rows) -> list[int]:
    """Choose stretches, longest first, that lie mostly outside those chosen: periodic content fits at many offsets."""
    kept: list[int] = []
    for k in range(min(len(first), 10 * _MOST_STRETCHES)):
        common = np.minimum(last[kept], last[k]) - np.maximum(first[kept], first[k])
        if not (2 * common > last[k] - first[k]).any():
            kept.append(k)
    return kept


def _grown(found: _Found, table: _Anchors, k: int, count: int, rows_a: int, rows_b: int) -> tuple[int, int, int, int]:
    """Rows of a stretch in `a` and `b`, grown to the ends of `a` where no anchor of it speaks against that."""
    first, last = found.first_a[k : k + 1], found.last_a[k : k + 1]
    first_a, last_a = int(table.row[first[0]]), int(table.row[last[0]]) + SHINGLE - 1
    offset = int(table.row[found.first_b[k]]) - first_a
    if _place(table, first, found.first_b[k : k + 1])[0] == 0:
        first_a = max(0, -offset)
    if _place(table, last, found.last_b[k : k + 1])[0] == count - 1:
        last_a = min(rows_a - 1, rows_b - 1 - offset)
    return first_a, last_a, first_a + offset, last_a + offset
