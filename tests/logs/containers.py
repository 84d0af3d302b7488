"""MCAP files with known messages, written by the mcap library and damaged by hand, and a reader of all their spans."""

import struct
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from maglev_offline.logs.chunks import load_span
from maglev_offline.logs.counts import Shortfall, shortfall
from maglev_offline.logs.scan import read_structure
from maglev_offline.logs.source import Source, open_source
from maglev_offline.logs.structure import DAMAGES, Damage, Structure

T0 = 1_700_000_000_000_000_000
COMPRESSION = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}


class Message(NamedTuple):
    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    payload: bytes


class Read(NamedTuple):
    """All that could be read of a file."""

    structure: Structure
    messages: list[Message]
    damages: list[Damage]
    short: Shortfall

    @property
    def codes(self) -> list[str]:
        return [damage.code for damage in self.damages]

    @property
    def lost(self) -> int:
        """Messages that damages are known to have taken."""
        return sum(sum((damage.messages or {}).values()) for damage in self.damages)

    @property
    def missing(self) -> int:
        """Messages that the statistics have beyond those."""
        return sum(self.short.in_damage.values()) + sum(self.short.unexplained.values())


def messages(n: int, channels: int = 3, seed: int = 0) -> list[Message]:
    """Messages of the channels in turn, of several lengths, with content that does not compress to nothing."""
    rng = np.random.default_rng(seed)
    made = []
    for k in range(n):
        payload = rng.bytes(int(rng.integers(8, 24)) if k % 3 else 16) + struct.pack("<d", k / 7)
        made.append(Message(k % channels + 1, k, T0 + k * 1_000_000, T0 + k * 1_000_000 - 5, payload))
    return made


def write(
    path: Path,
    made: list[Message],
    *,
    compression: str = "zstd",
    chunk_size: int = 4096,
    chunked: bool = True,
    **more: Any,
) -> Path:
    """Write the messages with the library's writer; channel k is topic /k with a schema."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=COMPRESSION[compression], use_chunking=chunked, **more)
        writer.start()
        writer.add_metadata("rig", {"operator": "k"})
        schema = writer.register_schema("test/Blob", "ros2msg", b"uint8[] data")
        for k in range(1, max((m.channel_id for m in made), default=1) + 1):
            assert writer.register_channel(f"/{k}", "cdr", schema) == k
        for m in made:
            writer.add_message(m.channel_id, m.log_time_ns, m.payload, m.publish_time_ns, m.sequence)
        writer.add_attachment(1, 2, "../photo.jpg", "image/jpeg", bytes(999))
        writer.finish()
    return path


def read(path: Path | str) -> Read:
    """Read every span of a file."""
    with open_source(path) as source:
        return read_from(source)


def read_content(content: bytes) -> Read:
    """The same of bytes in memory."""
    return read_from(Source("memory", len(content), True, lambda offset, length: content[offset : offset + length]))


def read_from(source: Source) -> Read:
    """Read every span; the damages are those of the structure, then those of the spans."""
    found: list[Message] = []
    structure = read_structure(source)
    damages = list(structure.damages)
    for span in structure.spans:
        loaded = load_span(source, span, structure.channels)
        damages += loaded.damages
        table, data = loaded.messages, loaded.data.tobytes()
        columns = (vars(table)[name].tolist() for name in vars(table))
        for channel, sequence, log, publish, start, length in zip(*columns, strict=True):
            found.append(Message(channel, sequence, log, publish, data[start : start + length]))
    assert {damage.code for damage in damages} <= DAMAGES.keys()
    assert all(0 <= d.offset <= d.offset + d.length <= source.size for d in damages)
    counts = Counter(m.channel_id for m in found)
    return Read(structure, found, damages, shortfall(structure.claimed, counts, damages))


def chunk_indexes(path: Path) -> list[Any]:
    """The ChunkIndex records as the library reads them."""
    with path.open("rb") as file:
        return make_reader(file).get_summary().chunk_indexes


def damage(path: Path, at: int, content: bytes) -> None:
    """Overwrite bytes."""
    data = bytearray(path.read_bytes())
    data[at : at + len(content)] = content
    path.write_bytes(data)


def flip(path: Path, at: int) -> None:
    """Flip all bits of one byte."""
    damage(path, at, bytes([path.read_bytes()[at] ^ 0xFF]))


def without_summary(path: Path) -> Path:
    """Cut the file off where its data section ends."""
    with path.open("rb") as file:
        start = make_reader(file).get_summary() and struct.unpack("<Q", path.read_bytes()[-28:-20])[0]
    path.write_bytes(path.read_bytes()[: start - 13])
    return path
