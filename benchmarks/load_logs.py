"""The logs of `load.py`: those of `ingest_logs`, in cdr, written a chunk at a time, which takes a seventh of the time.

All messages have one size, so that the records of a chunk are rows of one array; what is around them is written by the
mcap package's own records.
"""

import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import zstandard
from ingest_logs import FIELDS, POINTS, TOPICS, blocks, cdr_schema
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.typing import NDArray

MAGIC = b"\x89MCAP0\r\n"
CHUNK_TICKS = 300
"""Ticks of all points in a chunk, 1.9 MB."""

_TYPE = "bench/msg/SuspensionState"
_FIELDS = ("<u1", "<u8", "<u2", "<u4", "<u8", "<u8", "<u4", "<i4", "<u4", "<u4", ("<f8", (len(FIELDS),)))
_NAMES = ("opcode", "length", "channel", "count", "log_time", "publish_time", "head", "sec", "nanosec", "sequence",
          "values")  # fmt: skip
# A message record, and in it the payload: 4 bytes of head, then the fields aligned to its fifth byte.
_OFFSETS = (0, 1, 9, 11, 15, 23, 31, 35, 39, 43, 51)
MESSAGE = np.dtype({"names": list(_NAMES), "formats": list(_FIELDS), "offsets": list(_OFFSETS)})
_INDEX = np.dtype([("log_time", "<u8"), ("offset", "<u8")])


def write_day(path: Path, ticks: int, first_tick: int = 0) -> None:
    """Write so many ticks of 100 ms of all points, unless the log is there; it appears under its name when whole."""
    if path.exists():
        return
    draft = path.with_name(f".{path.name}.draft")
    with draft.open("wb") as file:
        _write(file, ticks, first_tick)
    draft.replace(path)


def _write(file: BinaryIO, ticks: int, first_tick: int) -> None:
    schema = records.Schema(data=cdr_schema(), encoding="ros2msg", id=1, name=_TYPE)
    channels = [records.Channel(k + 1, topic, "cdr", {}, 1) for k, topic in enumerate(TOPICS)]
    file.write(MAGIC + _bytes(records.Header("ros2", "maglev-offline benchmark"), schema, *channels))
    indexes: list[records.ChunkIndex] = []
    for block in blocks(ticks * POINTS, first_tick):
        rows = _messages(block)
        cuts = range(0, len(rows), CHUNK_TICKS * POINTS)
        indexes += [_write_chunk(file, rows[first : first + CHUNK_TICKS * POINTS]) for first in cuts]
    file.write(_bytes(records.DataEnd(0)))
    start = file.tell()
    counts = dict.fromkeys(range(1, POINTS + 1), ticks)
    times = (min(one.message_start_time for one in indexes), max(one.message_end_time for one in indexes))
    about = records.Statistics(
        attachment_count=0, channel_count=POINTS, channel_message_counts=counts, chunk_count=len(indexes),
        message_count=ticks * POINTS, message_start_time=times[0], message_end_time=times[1], metadata_count=0,
        schema_count=1,
    )  # fmt: skip
    file.write(_bytes(schema, *channels, about, *indexes, records.Footer(start, 0, 0)) + MAGIC)


def _bytes(*some: Any) -> bytes:
    stream = RecordBuilder()
    for one in some:
        one.write(stream)
    return bytes(stream.end())


def _messages(block: Any) -> NDArray[Any]:
    rows = np.zeros(len(block.sequence), MESSAGE)
    rows["opcode"], rows["length"] = Opcode.MESSAGE, MESSAGE.itemsize - 9
    rows["channel"] = np.arange(len(rows)) % POINTS + 1
    rows["count"] = rows["sequence"] = block.sequence
    rows["log_time"], rows["publish_time"] = block.log_time_ns, block.stamp_ns
    rows["head"] = 0x00000100  # little-endian CDR
    rows["sec"], rows["nanosec"] = np.divmod(block.stamp_ns, 10**9)
    rows["values"] = block.values
    return rows


def _write_chunk(file: BinaryIO, rows: NDArray[Any]) -> records.ChunkIndex:
    """Write the rows and where each channel's are; what the summary says of them."""
    raw = rows.tobytes()
    packed = zstandard.compress(raw)
    first, last = int(rows["log_time"].min()), int(rows["log_time"].max())
    start = file.tell()
    chunk = records.Chunk("zstd", packed, last, first, zlib.crc32(raw), len(raw))
    file.write(_bytes(chunk))
    length, offsets = file.tell() - start, {}
    at = np.arange(len(rows), dtype=np.uint64) * np.uint64(MESSAGE.itemsize)
    for channel in range(1, POINTS + 1):
        mine = rows["channel"] == channel
        index = np.zeros(np.count_nonzero(mine), _INDEX)
        index["log_time"], index["offset"] = rows["log_time"][mine], at[mine]
        offsets[channel] = file.tell()
        content = channel.to_bytes(2, "little") + index.nbytes.to_bytes(4, "little") + index.tobytes()
        file.write(bytes([Opcode.MESSAGE_INDEX]) + len(content).to_bytes(8, "little") + content)
    indexes = file.tell() - start - length
    return records.ChunkIndex(
        chunk_length=length, chunk_start_offset=start, compression="zstd", compressed_size=len(packed),
        message_end_time=last, message_index_length=indexes, message_index_offsets=offsets,
        message_start_time=first, uncompressed_size=len(raw),
    )  # fmt: skip
