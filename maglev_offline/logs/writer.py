"""MCAP files from columns: json, cdr (ROS 2) or protobuf messages of float64 fields, in zstd chunks."""

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from maglev_offline import __version__

Encoding = Literal["json", "cdr", "protobuf"]
ENCODINGS: tuple[Encoding, ...] = ("json", "cdr", "protobuf")

_CHUNK_BYTES = 256 * 1024
"""Small enough that a truncated log loses little."""


@dataclass(frozen=True)
class MessageType:
    """The one type that all topics of a log carry: a name and its fields with their units, all of them float64.

    `name` is a ROS 2 name such as `maglev/msg/SuspensionState`; protobuf gets dots in place of the slashes.
    """

    name: str
    units: Mapping[str, str]


@dataclass(frozen=True)
class Messages:
    """Messages in the order in which they are written, which need not be the order of their times.

    `topic` [n]: index into the topics; times [n] in ns since the epoch; `sequence` [n]; `values` [n, fields].
    """

    topic: NDArray[np.int64]
    log_time_ns: NDArray[np.int64]
    publish_time_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    values: NDArray[np.float64]


def write_log(
    path: Path,
    topics: Sequence[str],
    message_type: MessageType,
    messages: Messages,
    *,
    encoding: Encoding,
    metadata: Mapping[str, Mapping[str, str]],
) -> None:
    """Write an MCAP file; it appears under its name only when whole. The same arguments give the same bytes.

    `metadata`: MCAP metadata records by name, written before the first message.
    """
    schema_encoding, schema = _SCHEMAS[encoding](message_type)
    encode = _ENCODERS[encoding](message_type, schema)
    draft = path.with_name(f".{path.name}.draft")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with draft.open("wb") as file:
            writer = Writer(file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
            writer.start(profile="", library=f"maglev-offline {__version__}")
            for title, record in metadata.items():
                writer.add_metadata(title, dict(record))
            name = _protobuf_name(message_type) if encoding == "protobuf" else message_type.name
            schema_id = writer.register_schema(name, schema_encoding, schema)
            channels = [writer.register_channel(topic, encoding, schema_id) for topic in topics]
            columns = (messages.topic, messages.log_time_ns, messages.publish_time_ns, messages.sequence)
            rows = zip(*(column.tolist() for column in columns), messages.values.tolist(), strict=True)
            for topic, log_time, publish_time, sequence, values in rows:
                writer.add_message(channels[topic], log_time, encode(values), publish_time, sequence)
            writer.finish()  # type: ignore[no-untyped-call]
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def _json_schema(message_type: MessageType) -> tuple[str, bytes]:
    fields = {name: {"type": "number", "description": unit} for name, unit in message_type.units.items()}
    schema = {"title": message_type.name, "type": "object", "properties": fields, "required": list(fields)}
    return "jsonschema", json.dumps(schema).encode()


def _ros2_schema(message_type: MessageType) -> tuple[str, bytes]:
    lines = (f"float64 {name} # {unit}\n" for name, unit in message_type.units.items())
    return "ros2msg", "".join(lines).encode()


def _protobuf_schema(message_type: MessageType) -> tuple[str, bytes]:
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet

    package, _, name = _protobuf_name(message_type).rpartition(".")
    file = FileDescriptorProto(name=f"{name}.proto", package=package, syntax="proto3")
    message = file.message_type.add(name=name)
    for number, field in enumerate(message_type.units, start=1):
        message.field.add(
            name=field,
            number=number,
            type=FieldDescriptorProto.TYPE_DOUBLE,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
        )
    return "protobuf", FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)


def _protobuf_name(message_type: MessageType) -> str:
    return message_type.name.replace("/", ".")


Encode = Callable[[list[float]], bytes]


def _json_encoder(message_type: MessageType, schema: bytes) -> Encode:  # noqa: ARG001
    names = list(message_type.units)
    return lambda values: json.dumps(dict(zip(names, values, strict=True)), separators=(",", ":")).encode()


def _cdr_encoder(message_type: MessageType, schema: bytes) -> Encode:  # noqa: ARG001
    pack = struct.Struct(f"<4B{len(message_type.units)}d").pack
    return lambda values: pack(0, 1, 0, 0, *values)  # the header says little-endian CDR


def _protobuf_encoder(message_type: MessageType, schema: bytes) -> Encode:
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass

    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    kind: Any = GetMessageClass(pool.FindMessageTypeByName(_protobuf_name(message_type)))
    names = list(message_type.units)
    return lambda values: bytes(kind(**dict(zip(names, values, strict=True))).SerializeToString(deterministic=True))


_SCHEMAS: dict[Encoding, Callable[[MessageType], tuple[str, bytes]]] = {
    "json": _json_schema,
    "cdr": _ros2_schema,
    "protobuf": _protobuf_schema,
}
_ENCODERS: dict[Encoding, Callable[[MessageType, bytes], Encode]] = {
    "json": _json_encoder,
    "cdr": _cdr_encoder,
    "protobuf": _protobuf_encoder,
}
