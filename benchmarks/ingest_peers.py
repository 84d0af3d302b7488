"""The ways to read a log that `ingest.py` compares, each run alone in a process of its own.

`python ingest_peers.py NAME LOG --warm-up LOG` runs one of them and prints one line of JSON: CPU seconds, messages,
the process's peak memory, and a digest of what was read from the log for warming up. Of maglev-offline only "ours"
imports anything, so that a peer can run in an environment of its own.
"""

import argparse
import hashlib
import json
import resource
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FIELDS = (
    "gap_mm",
    "gap_velocity_mm_s",
    "coil_current_a",
    "coil_voltage_v",
    "set_point_mm",
    "speed_km_h",
    "load_kg",
)
COLUMNS = ("log_time_ns", "publish_time_ns", "stamp_ns", "sequence", *FIELDS)
"""What every way makes of the messages, beside the topic."""

FLOOR = "decompress and check"
OURS, OURS_INGEST = "maglev-offline", "maglev-offline ingest"
MCAP, MCAP_DEFAULT, MCAP_PARQUET = "mcap, file order", "mcap, default order", "mcap, file order, to Parquet"
ROSBAGS, RERUN = "rosbags", "rerun-sdk"


class Done(NamedTuple):
    """How many messages came out, and the table of them, where there is one."""

    messages: int
    table: pa.Table | None = None


def floor(path: Path) -> Done:
    """Read and decompress all chunks and check their sums; no message is looked at."""
    import zstandard
    from mcap.reader import make_reader

    decompressor = zstandard.ZstdDecompressor()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        for chunk in summary.chunk_indexes:
            file.seek(chunk.chunk_start_offset + 9)
            record = file.read(chunk.chunk_length)
            claimed = int.from_bytes(record[24:28], "little")
            packed = memoryview(record)[40 + int.from_bytes(record[28:32], "little") :][: chunk.compressed_size]
            if zlib.crc32(decompressor.decompress(packed, max_output_size=chunk.uncompressed_size)) != claimed:
                raise ValueError("a chunk does not match its checksum")
        return Done(summary.statistics.message_count)


def ours(path: Path) -> Done:
    """`read_columns` of all topics, as one Arrow table."""
    from maglev_offline.logs.channels import list_channels
    from maglev_offline.logs.decode.library import ClockField
    from maglev_offline.logs.reader import read_columns

    topics = [channel.topic for channel in list_channels(path)]
    found = read_columns(
        path, dict.fromkeys(topics, ("sequence", *FIELDS)), dict.fromkeys(topics, ClockField("stamp"))
    ).values()
    arrays = {
        "log_time_ns": [one.log_time_ns for one in found],
        "publish_time_ns": [one.publish_time_ns for one in found],
        "stamp_ns": [one.clock_ns for one in found],
        "sequence": [one.values["sequence"] for one in found],
        **{name: [one.values[name] for one in found] for name in FIELDS},
    }
    table = pa.table({name: pa.chunked_array(parts) for name, parts in arrays.items()})
    counts = [len(one) for one in found]
    table = table.append_column("topic", _dictionary(np.repeat(np.arange(len(topics)), counts), topics))
    return Done(len(table), table)


def ours_ingest(path: Path) -> Done:
    """Signals found, all checks, resampling, ledger and findings: the folder that `maglev-offline ingest` makes."""
    from maglev_offline.ingest.log import ingest_log
    from maglev_offline.ingest.request import Request

    with tempfile.TemporaryDirectory() as out:
        made = ingest_log(path, "benchmark", Request(), Path(out))
    if made.counts["messages_used"] != made.counts["messages"]:
        raise ValueError(f"of {made.counts['messages']} messages {made.counts['messages_used']} were used")
    return Done(made.counts["messages"])


def mcap(path: Path, *, log_time_order: bool = False) -> Done:
    """The mcap reader with its decoders, message by message into lists, and those into an Arrow table."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory as Protobuf
    from mcap_ros2.decoder import DecoderFactory as Ros2

    rows: list[tuple[Any, ...]] = []
    topics: dict[str, int] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[_Json(), Protobuf(), Ros2()])
        for _, channel, message, content in reader.iter_decoded_messages(log_time_order=log_time_order):
            topic = topics.setdefault(channel.topic, len(topics))
            rows.append((topic, message.log_time, message.publish_time, *_fields(content)))
    return _of_rows(rows, list(topics))


def mcap_default_order(path: Path) -> Done:
    """The same in the reader's default order, which is that of the log times."""
    return mcap(path, log_time_order=True)


def mcap_to_parquet(path: Path) -> Done:
    """The mcap reader to an Arrow table, and that to one Parquet file in zstd; no checks, no resampling."""
    done = mcap(path)
    with tempfile.TemporaryDirectory() as out:
        pq.write_table(done.table, Path(out) / "messages.parquet", compression="zstd")
    return done


def rosbags(path: Path) -> Done:
    """`rosbags.highlevel.AnyReader`, message by message into lists, and those into an Arrow table."""
    from rosbags.highlevel import AnyReader

    rows: list[tuple[Any, ...]] = []
    topics: dict[str, int] = {}
    with AnyReader([path]) as reader:
        for connection, log_time, raw in reader.messages():
            content = reader.deserialize(raw, connection.msgtype)
            topic = topics.setdefault(connection.topic, len(topics))
            # It keeps no publish time; in these logs that is the stamp.
            stamp = content.stamp.sec * 10**9 + content.stamp.nanosec
            rows.append((topic, log_time, stamp, *_fields(content)))
    return _of_rows(rows, list(topics))


def rerun(path: Path) -> Done:
    """`rerun.chunk.McapReader`: its record batches of the messages, flattened to one Arrow table."""
    from rerun.chunk import McapReader

    parts: dict[str, list[pa.Array]] = {}
    topics: dict[str, int] = {}
    for chunk in McapReader(path).stream():
        batch = chunk.to_record_batch()
        content = next((name for name in batch.schema.names if name.endswith("SuspensionState:message")), None)
        if content is None:
            continue
        for name, array in _rerun_columns(batch, content):
            parts.setdefault(name, []).append(array)
        topic = topics.setdefault(batch.schema.metadata[b"rerun:entity_path"].decode(), len(topics))
        parts.setdefault("topic", []).append(_dictionary(np.full(batch.num_rows, topic), ["unnamed"] * (topic + 1)))
    if not parts:
        return Done(0)
    names = list(topics)
    parts["topic"] = [pa.DictionaryArray.from_arrays(array.indices, pa.array(names)) for array in parts["topic"]]
    table = pa.table({name: pa.chunked_array(arrays) for name, arrays in parts.items()})
    return Done(len(table), table)


def _rerun_columns(batch: Any, content: str) -> Iterator[tuple[str, pa.Array]]:
    for name in ("log_time", "publish_time"):
        yield f"{name}_ns", batch.column(f"message_{name}").cast(pa.int64())
    struct = batch.column(content).flatten()
    stamp = struct.field("stamp")
    parts = [stamp.field(field.name).to_numpy(zero_copy_only=False).astype(np.int64) for field in stamp.type]
    yield "stamp_ns", pa.array(parts[0] * 10**9 + parts[1])
    for name in ("sequence", *FIELDS):
        yield name, struct.field(name)


class _Json:
    """What a user of the mcap reader writes for JSON."""

    def decoder_for(self, message_encoding: str, schema: Any) -> Callable[[bytes], Any] | None:  # noqa: ARG002
        return json.loads if message_encoding == "json" else None


def _fields(content: Any) -> tuple[Any, ...]:
    """Stamp, sequence and the seven numbers of one decoded message."""
    if isinstance(content, dict):
        stamp = content["stamp"]
        return (stamp["sec"] * 10**9 + stamp["nanosec"], content["sequence"], *(content[name] for name in FIELDS))
    stamp = content.stamp
    if hasattr(stamp, "nanos"):
        nanoseconds = stamp.seconds * 10**9 + stamp.nanos
    else:
        nanoseconds = stamp.sec * 10**9 + stamp.nanosec
    return (
        nanoseconds,
        content.sequence,
        content.gap_mm,
        content.gap_velocity_mm_s,
        content.coil_current_a,
        content.coil_voltage_v,
        content.set_point_mm,
        content.speed_km_h,
        content.load_kg,
    )


def _of_rows(rows: list[tuple[Any, ...]], topics: list[str]) -> Done:
    index, *columns = zip(*rows, strict=True)
    table = pa.table(dict(zip(COLUMNS, columns, strict=True)))
    return Done(len(rows), table.append_column("topic", _dictionary(np.array(index), topics)))


def _dictionary(index: Any, names: list[str]) -> pa.DictionaryArray:
    return pa.DictionaryArray.from_arrays(pa.array(index, pa.int32()), pa.array(names))


CONTENDERS: dict[str, Callable[[Path], Done]] = {
    FLOOR: floor,
    OURS: ours,
    OURS_INGEST: ours_ingest,
    MCAP: mcap,
    MCAP_DEFAULT: mcap_default_order,
    MCAP_PARQUET: mcap_to_parquet,
    ROSBAGS: rosbags,
    RERUN: rerun,
}


def digest(table: pa.Table) -> str:
    """Return a hash of the messages in order of their log times, whatever the types and the order of the table."""
    order = np.argsort(table.column("log_time_ns").to_numpy(), kind="stable")
    found = hashlib.sha256()
    topics = np.asarray(table.column("topic").to_pylist())
    found.update("\n".join(topics[order].tolist()).encode())
    for name in COLUMNS:
        kind = np.float64 if name in FIELDS else np.int64
        found.update(table.column(name).to_numpy().astype(kind)[order].tobytes())
    return found.hexdigest()


def peak_bytes() -> int:
    """Return the most memory that this process has held."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def main(arguments: list[str] | None = None) -> int:
    """Run one way on one log, print what it took; exit with 3 where it is not installed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=CONTENDERS)
    parser.add_argument("log", type=Path)
    parser.add_argument("--warm-up", type=Path, required=True, help="a small log of the same kind, read beforehand")
    chosen = parser.parse_args(arguments)
    run = CONTENDERS[chosen.name]
    try:
        warm = run(chosen.warm_up)
    except ImportError as error:
        print(error, file=sys.stderr)
        return 3
    before_bytes, before_s = peak_bytes(), time.process_time()
    done = run(chosen.log)
    spent_s = time.process_time() - before_s
    result = {
        "cpu_s": spent_s,
        "messages": done.messages,
        "peak_bytes": peak_bytes(),
        "peak_bytes_before": before_bytes,
        "digest": digest(warm.table) if warm.table is not None else "",
        "warm_up_messages": warm.messages,
    }
    print(json.dumps(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
