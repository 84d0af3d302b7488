"""Slabs: sorted by topic, on disk what they are in memory, and joined without a copy where they lie side by side."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.logs.slabs import Files, Piece, by_topic, join_cuts


def piece(n, paths=2):
    count = np.arange(n)
    return Piece(np.stack([count + 100 * k for k in range(5)]), np.full((paths, n), 0.5) * count, count % 3 > 0)


@given(st.lists(st.integers(0, 3), max_size=40))
def test_each_topic_keeps_its_messages_in_their_order(topics):
    of_row = np.array(topics, dtype=np.uint16)
    names = ["/a", "/b", "/c", "/d"]
    slab = by_topic(piece(len(topics)), of_row, names)
    assert slab.counts == {name: topics.count(k) for k, name in enumerate(names) if k in topics}
    with Files() as files:
        for k, name in enumerate(names):
            cut = slab.cut(name, files)
            rows = np.flatnonzero(of_row == k)
            if cut is None:
                assert len(rows) == 0
                continue
            for mine, its in zip(join_cuts([cut]), piece(len(topics)).take(rows), strict=True):
                np.testing.assert_array_equal(mine, its)


def test_disk_gives_back_what_memory_held(tmp_path):
    slabs = [by_topic(piece(n), np.arange(n, dtype=np.uint16) % 2, ["/a", "/b"]) for n in (7, 4, 1)]
    with (tmp_path / "slabs").open("wb") as file:
        spilled = [slab.spill(file) for slab in slabs]
    with Files() as files:
        for held, waiting in zip(slabs, spilled, strict=True):
            assert held.counts == waiting.counts
            assert waiting.cut("/c", files) is None
            for topic in held.counts:
                for mine, its in zip(
                    join_cuts([held.cut(topic, files)]), join_cuts([waiting.cut(topic, files)]), strict=True
                ):
                    np.testing.assert_array_equal(mine, its)
                    assert mine.dtype == its.dtype


def test_cuts_of_one_piece_that_do_not_touch_are_joined_all_the_same():
    whole = piece(10)
    joined = join_cuts([(whole, 0, 3), (whole, 5, 7)])
    assert joined.integers[0].tolist() == [0, 1, 2, 5, 6]
