"""Decoding all parts of a recording: what was found, what was lost, and that memory or disk makes no difference."""

import importlib.util
import struct
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import IndexType

from maglev_offline.ingest import decoded
from maglev_offline.ingest.decoded import decode_parts, open_parts
from maglev_offline.logs.reader import TopicWanted, topic_columns
from maglev_offline.logs.slabs import DiskSlab, MemorySlab

_spec = importlib.util.spec_from_file_location("containers", Path(__file__).parents[1] / "logs/containers.py")
containers = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(containers)

HEADERS = {f"/{k}": TopicWanted(()) for k in (1, 2, 3)}


@pytest.fixture
def log(tmp_path):
    return containers.write(tmp_path / "a.mcap", containers.messages(900))


def decode(paths, tmp_path, **options):
    scratch = tmp_path / "scratch"
    scratch.mkdir(exist_ok=True)
    return decode_parts(open_parts(paths), HEADERS, scratch, **options)


def adds_up(found, of):
    """Every message is found or lost, for each topic."""
    total = Counter(found.found)
    for lost in found.lost:
        total[lost.topic] += lost.count
    assert total == of


def test_all_messages_are_found_in_their_order(log, tmp_path):
    made = decode([log], tmp_path)
    assert made.found == {"/1": 300, "/2": 300, "/3": 300}
    assert (made.lost, made.damages) == ((), ())
    columns = topic_columns(made.slabs, "/2", HEADERS["/2"])
    assert columns.file_index.tolist() == list(range(1, 900, 3)) == columns.sequence.tolist()


def test_parts_follow_each_other(log, tmp_path):
    other = containers.write(tmp_path / "b.mcap", containers.messages(90))
    made = decode([log, other], tmp_path)
    assert made.found == {"/1": 330, "/2": 330, "/3": 330}
    assert topic_columns(made.slabs, "/1", HEADERS["/1"]).file_index.tolist() == list(range(0, 990, 3))


def test_damage_tells_the_number_of_its_part(log, tmp_path):
    other = containers.write(tmp_path / "b.mcap", containers.messages(900))
    index = containers.chunk_indexes(other)[2]
    containers.flip(other, index.chunk_start_offset + index.chunk_length // 2)
    made = decode([log, other], tmp_path)
    assert [number for number, _ in made.damages] == [1]
    assert {lost.byte_offset for lost in made.lost} == {index.chunk_start_offset}
    adds_up(made, {"/1": 600, "/2": 600, "/3": 600})


def same_columns(one, other):
    for topic, wanted in HEADERS.items():
        for a, b in zip(
            topic_columns(one.slabs, topic, wanted).arrays(), topic_columns(other.slabs, topic, wanted).arrays(),
            strict=True,
        ):  # fmt: skip
            np.testing.assert_array_equal(a, b)


def test_what_memory_cannot_hold_waits_on_disk(log, tmp_path, monkeypatch):
    monkeypatch.setattr("maglev_offline.logs.reader.RUN_BYTES", 4096)
    held = decode([log], tmp_path)
    assert {type(slab) for slab, _ in held.slabs} == {MemorySlab}
    monkeypatch.setattr(decoded, "IN_MEMORY_BYTES", 10_000)
    spilled = decode([log], tmp_path)
    assert {type(slab) for slab, _ in spilled.slabs} == {DiskSlab}
    assert [(slab.counts, n) for slab, n in spilled.slabs] == [(slab.counts, n) for slab, n in held.slabs]
    same_columns(held, spilled)


def test_two_processes_find_the_same(log, tmp_path, monkeypatch):
    monkeypatch.setattr("maglev_offline.logs.reader.RUN_BYTES", 8192)
    one, two = decode([log], tmp_path, jobs=1), decode([log], tmp_path, jobs=2)
    assert {type(slab) for slab, _ in two.slabs} == {DiskSlab}
    assert (one.found, one.lost, one.damages, one.rungs) == (two.found, two.lost, two.damages, two.rungs)
    same_columns(one, two)


def test_what_a_broken_chunk_tells_of_its_channels_is_held_against_the_statistics(tmp_path):
    """Without an index, the channels of the messages are read off content that is known to be wrong."""
    path = containers.write(
        tmp_path / "a.mcap", containers.messages(900), compression="none",
        index_types=IndexType.ALL & ~IndexType.MESSAGE,
    )  # fmt: skip
    data, at = bytearray(path.read_bytes()), containers.chunk_indexes(path)[2].chunk_start_offset
    # Ten messages of channel 1 in the third chunk become messages of channel 2.
    changed = 0
    for m in containers.messages(900)[::3]:
        head = data.find(m.payload) - 22
        if head > at and changed < 10:
            data[head : head + 2] = struct.pack("<H", 2)
            changed += 1
    path.write_bytes(data)
    made = decode([path], tmp_path)
    assert {damage.code for _, damage in made.damages} == {"chunk_crc_mismatch"}
    adds_up(made, {"/1": 300, "/2": 300, "/3": 300})
    assert sum(lost.count for lost in made.lost if lost.code == "missing") == 10


def test_a_log_without_statistics_is_taken_at_its_word(tmp_path):
    path = containers.write(tmp_path / "a.mcap", containers.messages(900), use_statistics=False)
    index = containers.chunk_indexes(path)[2]
    containers.flip(path, index.chunk_start_offset + index.chunk_length // 2)
    made = decode([path], tmp_path)
    adds_up(made, {"/1": 300, "/2": 300, "/3": 300})
    assert "missing" not in {lost.code for lost in made.lost}


def test_an_index_that_tells_of_too_few_messages_fills_no_memory(log, tmp_path, monkeypatch):
    monkeypatch.setattr("maglev_offline.logs.reader.RUN_BYTES", 4096)
    whole = decode([log], tmp_path)
    parts = open_parts([log])
    channels = tuple(replace(channel, message_count=1) for channel in parts[0].info.channels)
    understated = [replace(parts[0], info=replace(parts[0].info, channels=channels))]
    monkeypatch.setattr(decoded, "IN_MEMORY_BYTES", 1000)
    found = decode_parts(understated, HEADERS, tmp_path)
    assert {type(slab) for slab, _ in found.slabs} == {MemorySlab, DiskSlab}
    same_columns(whole, found)
