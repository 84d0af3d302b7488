"""Counts by channel, without decoding and mostly without reading, and what is missing from them."""

import pytest

from maglev_offline.logs.counts import ChannelCount, count_messages, shortfall
from maglev_offline.logs.scan import read_structure
from maglev_offline.logs.source import open_source
from maglev_offline.logs.structure import Damage


def counted(path):
    with open_source(path) as source:
        return count_messages(source, read_structure(source))


@pytest.mark.parametrize("options", [{}, {"chunked": False}, {"index": False}, {"summary": False}])
def test_counts_and_times_by_channel(containers, tmp_path, options):
    from mcap.writer import IndexType

    made = containers.messages(1000, channels=4)
    made.insert(500, containers.Message(2, 0, 5, 5, b"early"))
    index = IndexType.ALL if options.get("index", True) else IndexType.NONE
    path = containers.write(tmp_path / "a.mcap", made, chunked=options.get("chunked", True), index_types=index)
    if not options.get("summary", True):
        containers.without_summary(path)
    t0 = containers.T0
    assert counted(path) == {
        1: ChannelCount(250, t0, t0 + 996_000_000),
        2: ChannelCount(251, 5, t0 + 997_000_000),
        3: ChannelCount(250, t0 + 2_000_000, t0 + 998_000_000),
        4: ChannelCount(250, t0 + 3_000_000, t0 + 999_000_000),
    }


def test_an_index_that_cannot_be_is_not_believed(containers, tmp_path):
    path = containers.write(tmp_path / "a.mcap", containers.messages(1000))
    whole = counted(path)
    chunk = containers.chunk_indexes(path)[2]
    containers.damage(path, chunk.chunk_start_offset + chunk.chunk_length, bytes(chunk.message_index_length))
    assert counted(path) == whole


class TestShortfall:
    def test_what_a_damage_is_known_to_have_taken_is_not_missing(self):
        damages = [Damage("chunk_crc_mismatch", 0, 9, {1: 10}, ""), Damage("message_index_mismatch", 0, 9, {}, "")]
        assert shortfall({1: 30, 2: 5}, {1: 20, 2: 5}, damages) == ({}, {}, {})
        assert shortfall({1: 30, 2: 5}, {1: 17, 2: 5}, damages) == ({}, {1: 3}, {})

    def test_a_damage_of_unknown_content_may_have_taken_the_rest(self):
        damages = [Damage("bytes_unreadable", 0, 9, None, ""), Damage("chunk_crc_mismatch", 0, 9, {1: 10}, "")]
        assert shortfall({1: 30, 2: 5}, {1: 17}, damages) == ({1: 3, 2: 5}, {}, {})

    def test_more_than_claimed(self):
        assert shortfall({1: 3}, {1: 4, 2: 1}, []) == ({}, {}, {1: 1, 2: 1})

    def test_nothing_claimed(self):
        assert shortfall(None, {1: 4}, []) == ({}, {}, {})
