"""Finding messages in whole records, by the index or from record to record, gives the same table or says no."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.logs.message_index import IndexEntries, parse_index, sound_counts
from maglev_offline.logs.messages import chain, from_index, from_records

MESSAGE, SCHEMA, CHANNEL = 5, 3, 4


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def message(channel, sequence, payload):
    return record(MESSAGE, struct.pack("<HIQQ", channel, sequence, 10 + sequence, 20 + sequence) + payload)


def as_bytes(records):
    return np.frombuffer(b"".join(records), dtype=np.uint8)


def index_of(records, order=None):
    """The true index of the records, its entries by channel as writers have them."""
    at, entries = 0, []
    for r in records:
        if r[0] == MESSAGE:
            channel, _, log_time = struct.unpack_from("<HIQ", r, 9)
            entries.append((channel, log_time, at))
        at += len(r)
    entries.sort(key=lambda e: e[0])
    entries = [entries[k] for k in order] if order is not None else entries
    columns = list(zip(*entries, strict=True)) or [(), (), ()]
    return IndexEntries(
        np.array(columns[0], np.uint16), np.array(columns[1], np.uint64), np.array(columns[2], np.uint64)
    )


def rows(found):
    table = found.messages
    return list(zip(*(vars(table)[name].tolist() for name in vars(table)), strict=True))


RECORDS = [
    record(SCHEMA, b"schema"),
    message(1, 0, b"abc"),
    message(2, 1, b""),
    record(CHANNEL, b"c"),
    record(0x81, b"?"),
    message(1, 2, b"defg"),
    record(SCHEMA, b"end"),
]

any_record = st.one_of(
    st.builds(message, st.integers(0, 5), st.integers(0, 2**32 - 1), st.sampled_from([b"", b"a" * 8, b"b" * 40])),
    st.builds(record, st.sampled_from([SCHEMA, CHANNEL, 0x0F, 0xFF]), st.binary(max_size=20)),
)
runs = st.lists(st.tuples(any_record, st.integers(1, 200)), max_size=8).map(
    lambda r: [x for x, n in r for _ in range(n)]
)


class TestTables:
    def test_each_message_with_its_header_and_place(self):
        data = as_bytes(RECORDS)
        found = from_records(data)
        assert rows(found) == [(1, 0, 10, 20, 46, 3), (2, 1, 11, 21, 80, 0), (1, 2, 12, 22, 131, 4)]
        assert data[46:49].tobytes() == b"abc"
        assert [(opcode, length) for opcode, _, length in found.others] == [(3, 15), (4, 10), (0x81, 10), (3, 12)]
        assert found.stop == len(data)
        assert found.messages.channel_id.dtype == np.uint16
        assert found.messages.log_time_ns.dtype == np.uint64

    def test_the_index_gives_the_same_in_whatever_order_it_is(self):
        for order in (None, [2, 0, 1]):
            by_index = from_index(as_bytes(RECORDS), index_of(RECORDS, order))
            assert rows(by_index) == rows(from_records(as_bytes(RECORDS)))
            assert by_index.others == from_records(as_bytes(RECORDS)).others

    @given(runs)
    @settings(max_examples=150, deadline=None)
    def test_both_ways_agree_and_cover_every_byte(self, records):
        data = as_bytes(records)
        walked, indexed = from_records(data), from_index(data, index_of(records))
        assert rows(walked) == rows(indexed)
        assert walked.others == indexed.others
        assert len(walked.messages) == sum(r[0] == MESSAGE for r in records)
        assert len(walked.messages) + len(walked.others) == len(records)
        assert walked.stop == len(data)

    @pytest.mark.parametrize("missing", [0, 1, 2])
    def test_an_index_without_one_of_the_messages_is_refused(self, missing):
        entries = index_of(RECORDS, [k for k in range(3) if k != missing])
        assert from_index(as_bytes(RECORDS), entries) is None

    @pytest.mark.parametrize("column", [0, 1, 2])
    @pytest.mark.parametrize("by", [1, 3, 1000, 2**63])
    def test_an_index_with_a_wrong_entry_is_refused(self, column, by):
        entries = [c.copy() for c in index_of(RECORDS)]
        entries[column][1] += np.array(by).astype(entries[column].dtype)
        if (entries[column] == index_of(RECORDS)[column]).all():
            pytest.skip("no change in 16 bits")
        assert from_index(as_bytes(RECORDS), IndexEntries(*entries)) is None

    def test_an_index_that_has_a_message_twice_is_refused(self):
        assert from_index(as_bytes(RECORDS), index_of(RECORDS, [0, 1, 1, 2])) is None


class TestChain:
    @pytest.mark.parametrize("cut", range(1, 31))
    def test_it_stops_before_a_record_that_is_cut_off(self, cut):
        records = [message(1, k, b"") for k in range(300)]
        data = as_bytes(records)
        found = chain(data, 0, len(data) - cut)
        assert found.stop == 299 * 31
        assert len(found.offset) == 299

    @pytest.mark.parametrize("at", [0, 1, 2, 63, 64, 65, 66, 200, 299])
    @pytest.mark.parametrize("bad", [b"\0", struct.pack("<BQ", MESSAGE, 2**40), record(MESSAGE, bytes(21))])
    def test_it_stops_at_nonsense_wherever_it_is(self, at, bad):
        content = bytearray(b"".join(message(1, k, b"") for k in range(300)))
        content[at * 31 : at * 31 + len(bad)] = bad
        found = chain(np.frombuffer(bytes(content), np.uint8), 0, len(content))
        assert found.stop == at * 31
        assert found.offset.tolist() == [k * 31 for k in range(at)]

    def test_a_length_of_2_64_is_no_overflow(self):
        content = struct.pack("<BQ", MESSAGE, 2**64 - 1) + bytes(100)
        assert chain(np.frombuffer(content, np.uint8), 0, len(content)).stop == 0


class TestIndexRecords:
    def block(self, *groups):
        made = b""
        for channel, pairs in groups:
            body = b"".join(struct.pack("<QQ", *pair) for pair in pairs)
            made += record(7, struct.pack("<HI", channel, len(body)) + body)
        return made

    def test_entries_of_several_records(self):
        entries = parse_index(self.block((3, [(10, 0), (12, 62)]), (4, []), (1, [(11, 31)])))
        assert entries.channel_id.tolist() == [3, 3, 1]
        assert entries.log_time_ns.tolist() == [10, 12, 11]
        assert entries.offset.tolist() == [0, 62, 31]
        assert entries.counts() == {1: 1, 3: 2}
        assert sound_counts(entries, 93) == {1: 1, 3: 2}

    def test_no_records_are_no_entries(self):
        assert len(parse_index(b"").offset) == 0
        assert sound_counts(parse_index(b""), 100) is None

    def test_offsets_that_cannot_be_are_not_sound(self):
        entries = parse_index(self.block((3, [(10, 0), (12, 62)])))
        assert sound_counts(entries, 92) is None
        assert sound_counts(parse_index(self.block((3, [(10, 0), (12, 0)]))), 1000) is None
        assert sound_counts(parse_index(self.block((3, [(10, 2**64 - 1)]))), 1000) is None

    def test_what_is_no_index_is_none(self):
        good = self.block((3, [(10, 0), (12, 62)]))
        for cut in range(1, len(good)):
            assert parse_index(good[:cut]) is None
        for at in (0, 1, 5, 8, 11, 14):
            assert parse_index(good[:at] + bytes([good[at] ^ 0x41]) + good[at + 1 :]) is None
