"""The logs that ingestion is measured on: 60 suspension points, each every 100 ms, in 2 MiB chunks of zstd."""

import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from google.protobuf import timestamp_pb2
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from maglev_offline.physics.parameters import Plant

ENCODINGS = ("cdr", "protobuf", "json")
POINTS = 60
TOPICS = tuple(f"/suspension/P{k}/state" for k in range(1, POINTS + 1))
FIELDS = (
    "gap_mm",
    "gap_velocity_mm_s",
    "coil_current_a",
    "coil_voltage_v",
    "set_point_mm",
    "speed_km_h",
    "load_kg",
)
"""All float64; beside them each message has a `stamp` and the uint32 `sequence`."""

CHUNK_BYTES = 2 * 2**20
PERIOD_NS = 100_000_000
FIRST_NS = 1_700_000_000 * 10**9

_BLOCK_TICKS = 1000
_TYPE = "bench/msg/SuspensionState"


class Block(NamedTuple):
    """Consecutive messages [n] of all points in turn: times in ns, what each counts, and `values` [n, fields]."""

    stamp_ns: NDArray[np.int64]
    log_time_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    values: NDArray[np.float64]


def blocks(messages: int, first_tick: int = 0) -> Iterator[Block]:
    """Yield the same messages every time: slow motion about the set-point, with the noise of sensors."""
    ticks = -(-messages // POINTS)
    for first in range(0, ticks, _BLOCK_TICKS):
        tick = first_tick + np.arange(first, min(first + _BLOCK_TICKS, ticks))
        block = _block(tick, np.random.default_rng([5, first_tick + first]))
        rest = messages - first * POINTS
        yield block if rest >= len(block.sequence) else Block(*(column[:rest] for column in block))


def _block(tick: NDArray[np.int64], random: np.random.Generator) -> Block:
    plant, point = Plant(), np.arange(POINTS)
    t_s, shape = tick[:, None] * 0.1, (len(tick), POINTS)
    phase = 0.7 * t_s + point
    gap_m = plant.set_point_m + 0.4e-3 * np.sin(phase) + random.normal(0, 5e-6, shape)
    velocity_m_s = 0.4e-3 * 0.7 * np.cos(phase) + random.normal(0, 2e-5, shape)
    hold = plant.equilibrium(gap_m)
    current_a = np.asarray(hold.current_a) + random.normal(0, 0.02, shape)
    voltage_v = plant.resistance_ohm * current_a + random.normal(0, 0.05, shape)
    speed_km_h = 60 + 40 * np.sin(0.01 * t_s) + random.normal(0, 0.02, shape)
    load_kg = plant.mass_kg + random.normal(0, 0.5, shape)
    set_point_m = np.full(shape, plant.set_point_m)
    signals = (1e3 * gap_m, 1e3 * velocity_m_s, current_a, voltage_v, 1e3 * set_point_m, speed_km_h, load_kg)
    stamp_ns = FIRST_NS + tick[:, None] * PERIOD_NS + point * 1_500_000 + random.integers(0, 20_000, shape)
    return Block(
        stamp_ns.ravel(),
        (stamp_ns + random.integers(100_000, 400_000, shape)).ravel(),
        np.repeat(tick, POINTS),
        np.stack([signal.ravel() for signal in signals], axis=1),
    )


def write_log(path: Path, encoding: str, messages: int) -> None:
    """Write a log unless it is there already; it appears under its name only when whole."""
    if path.exists():
        return
    schema_encoding, schema, encode = {"cdr": _cdr, "protobuf": _protobuf, "json": _json}[encoding]()
    name = _TYPE.replace("/", ".") if encoding == "protobuf" else _TYPE
    draft = path.with_name(f".{path.name}.draft")
    with draft.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="ros2" if encoding == "cdr" else "", library="maglev-offline benchmark")
        schema_id = writer.register_schema(name, schema_encoding, schema)
        channels = [writer.register_channel(topic, encoding, schema_id) for topic in TOPICS]
        for block in blocks(messages):
            times = (block.log_time_ns.tolist(), block.stamp_ns.tolist(), block.sequence.tolist())
            for k, (payload, log_time, stamp, sequence) in enumerate(zip(encode(block), *times, strict=True)):
                writer.add_message(channels[k % POINTS], log_time, payload, stamp, sequence)
        writer.finish()
    draft.replace(path)


Encode = Callable[[Block], list[bytes]]


def cdr_schema() -> bytes:
    """The definition of a message in ROS 2."""
    lines = ["builtin_interfaces/Time stamp", "uint32 sequence", *(f"float64 {name}" for name in FIELDS)]
    return "\n".join([*lines, "=" * 80, "MSG: builtin_interfaces/Time", "int32 sec", "uint32 nanosec", ""]).encode()


def _cdr() -> tuple[str, bytes, Encode]:
    layout = np.dtype(
        {
            "names": ["head", "sec", "nanosec", "sequence", "values"],
            "formats": ["<u4", "<i4", "<u4", "<u4", ("<f8", (len(FIELDS),))],
            "offsets": [0, 4, 8, 12, 20],
        }
    )

    def encode(block: Block) -> list[bytes]:
        rows = np.zeros(len(block.sequence), layout)
        rows["head"] = 0x00000100  # little-endian CDR
        rows["sec"], rows["nanosec"] = np.divmod(block.stamp_ns, 10**9)
        rows["sequence"], rows["values"] = block.sequence, block.values
        raw, size = rows.tobytes(), layout.itemsize
        return [raw[at : at + size] for at in range(0, len(raw), size)]

    return "ros2msg", cdr_schema(), encode


@cache
def _message_class() -> tuple[Any, bytes]:
    package, _, name = _TYPE.replace("/", ".").rpartition(".")
    stamp = FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    file = FileDescriptorProto(name="bench.proto", package=package, syntax="proto3", dependency=[stamp.name])
    message, one = file.message_type.add(name=name), FieldDescriptorProto.LABEL_OPTIONAL
    of_stamp = FieldDescriptorProto.TYPE_MESSAGE
    message.field.add(name="stamp", number=1, type=of_stamp, type_name=".google.protobuf.Timestamp", label=one)
    message.field.add(name="sequence", number=2, type=FieldDescriptorProto.TYPE_UINT32, label=one)
    for number, field in enumerate(FIELDS, start=3):
        message.field.add(name=field, number=number, type=FieldDescriptorProto.TYPE_DOUBLE, label=one)
    pool = DescriptorPool()
    pool.Add(stamp)
    pool.Add(file)
    kind = GetMessageClass(pool.FindMessageTypeByName(f"{package}.{name}"))
    return kind, FileDescriptorSet(file=[stamp, file]).SerializeToString(deterministic=True)


def _protobuf() -> tuple[str, bytes, Encode]:
    kind, schema = _message_class()

    def encode(block: Block) -> list[bytes]:
        seconds, nanos = np.divmod(block.stamp_ns, 10**9)
        rows = zip(seconds.tolist(), nanos.tolist(), block.sequence.tolist(), block.values.tolist(), strict=True)
        return [
            kind(
                stamp={"seconds": sec, "nanos": nano}, sequence=sequence, **dict(zip(FIELDS, values, strict=True))
            ).SerializeToString()
            for sec, nano, sequence, values in rows
        ]

    return "protobuf", schema, encode


def _json() -> tuple[str, bytes, Encode]:
    numbers: dict[str, Any] = {name: {"type": "number"} for name in FIELDS}
    whole = {"type": "integer"}
    stamp = {"type": "object", "properties": {"sec": whole, "nanosec": whole}}
    schema = {"type": "object", "properties": {"stamp": stamp, "sequence": whole, **numbers}}
    parts = ",".join(f'"{name}":%r' for name in FIELDS)
    text = '{"stamp":{"sec":%d,"nanosec":%d},"sequence":%d,' + parts + "}"

    def encode(block: Block) -> list[bytes]:
        seconds, nanos = np.divmod(block.stamp_ns, 10**9)
        rows = zip(seconds.tolist(), nanos.tolist(), block.sequence.tolist(), block.values.tolist(), strict=True)
        return [(text % (sec, nano, sequence, *values)).encode() for sec, nano, sequence, values in rows]

    return "jsonschema", json.dumps(schema).encode(), encode
