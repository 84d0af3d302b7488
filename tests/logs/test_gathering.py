"""Slabs become cuts of one piece of memory for each topic, and what does not fit keeps its own."""

import numpy as np
import pytest

from maglev_offline.logs.gathering import Gathering
from maglev_offline.logs.slabs import Files, MemorySlab, Piece, join_cuts


def piece(first, n):
    count = np.arange(first, first + n)
    return Piece(np.stack([count] * 5), np.stack([count * 0.5, count * 0.25]), count % 2 == 0)


def slabs(sizes):
    """Slabs of two topics; the messages of each count up."""
    made, at = [], 0
    for n in sizes:
        both = piece(at, 2 * n)
        made.append(MemorySlab({"/a": (both, 0, n), "/b": (both, n, 2 * n)}))
        at += 2 * n
    return made


def gathered(sizes, expected, most_bytes=10**6):
    room = Gathering(expected, most_bytes)
    taken = [room.take_in(slab) for slab in slabs(sizes)]
    with Files() as files:
        return {t: [slab.cut(t, files) for slab in taken] for t in ("/a", "/b")}


def same(cuts, topic, sizes):
    with Files() as files:
        plain = join_cuts([slab.cut(topic, files) for slab in slabs(sizes)])
    for mine, its in zip(join_cuts(cuts), plain, strict=True):
        np.testing.assert_array_equal(mine, its)


def test_joining_what_lies_side_by_side_copies_nothing():
    found = gathered([3, 5, 1], {"/a": 9, "/b": 9})
    for topic, cuts in found.items():
        same(cuts, topic, [3, 5, 1])
        whole = cuts[0][0]
        assert all(cut[0] is whole for cut in cuts)
        assert np.shares_memory(join_cuts(cuts).values, whole.values)


@pytest.mark.parametrize("expected", [{}, {"/a": 4, "/b": 9}, {"/a": 0}])
def test_more_messages_than_were_expected_are_all_there(expected):
    for topic, cuts in gathered([3, 5, 1], expected).items():
        same(cuts, topic, [3, 5, 1])


def test_a_log_that_claims_any_number_gets_no_more_memory_than_allowed():
    room = Gathering({"/a": 10**15, "/b": 3}, most_bytes=1000)
    taken = [room.take_in(slab) for slab in slabs([3])]
    with Files() as files:
        cuts = {t: [taken[0].cut(t, files)] for t in ("/a", "/b")}
    for topic in cuts:
        same(cuts[topic], topic, [3])
    assert len(cuts["/b"][0][0]) == 3
