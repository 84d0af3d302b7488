"""Small MCAP files in the three encodings, written by the mcap library's own writers and not by the package."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType, Writer
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer

ENCODINGS = ("json", "cdr", "protobuf")
COMPRESSION = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}


class Stamp(NamedTuple):
    """A header stamp; becomes a ROS Time, a protobuf Timestamp, or a JSON object of two integers."""

    sec: int
    nanosec: int


class Msg(NamedTuple):
    """One message; `value` holds numbers, stamps, lists of numbers and further such mappings."""

    topic: str
    t_ns: int
    value: Mapping[str, Any]
    publish_ns: int | None = None


def write(
    path: Path,
    messages: Iterable[Msg],
    *,
    encoding: str = "json",
    compression: str = "zstd",
    chunk_size: int = 4096,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    json_schema: bool = True,
    chunked: bool = True,
) -> Path:
    """Write the messages in the order given; each topic's type is that of its first message."""
    with path.open("wb") as file:
        _WRITERS[encoding](
            file, list(messages), COMPRESSION[compression], chunk_size, metadata or {}, json_schema, chunked
        )
    return path


def _write_json(file, messages, compression, chunk_size, metadata, json_schema, chunked):
    writer = Writer(file, chunk_size=chunk_size, compression=compression, use_chunking=chunked)
    writer.start()
    for name, record in metadata.items():
        writer.add_metadata(name, dict(record))
    channels: dict[str, int] = {}
    for k, m in enumerate(messages):
        if m.topic not in channels:
            text = json.dumps(_json_schema(m.value)).encode()
            schema = writer.register_schema("test.State", "jsonschema", text) if json_schema else 0
            channels[m.topic] = writer.register_channel(m.topic, "json", schema)
        payload = json.dumps(_plain(m.value)).encode()
        writer.add_message(channels[m.topic], m.t_ns, payload, m.t_ns if m.publish_ns is None else m.publish_ns, k)
    writer.finish()


def _write_cdr(file, messages, compression, chunk_size, metadata, _json_schema, _chunked):
    writer = Ros2Writer(file, chunk_size=chunk_size, compression=compression)
    for name, record in metadata.items():
        writer.add_metadata(name, dict(record))
    schemas: dict[str, Any] = {}
    for k, m in enumerate(messages):
        if m.topic not in schemas:
            name = f"test_msgs/msg/State{len(schemas)}"
            schemas[m.topic] = writer.register_msgdef(name, _ros2_text(m.value, f"State{len(schemas)}"))
        value = {n: v._asdict() if isinstance(v, Stamp) else v for n, v in m.value.items()}
        publish = m.t_ns if m.publish_ns is None else m.publish_ns
        writer.write_message(m.topic, schemas[m.topic], value, m.t_ns, publish, k)
    writer.finish()


def _write_protobuf(file, messages, compression, chunk_size, metadata, _json_schema, _chunked):
    writer = ProtobufWriter(file, chunk_size=chunk_size, compression=compression)
    for name, record in metadata.items():
        writer.add_metadata(name, dict(record))
    kinds: dict[str, Any] = {}
    for k, m in enumerate(messages):
        if m.topic not in kinds:
            kinds[m.topic] = _protobuf_class(m.value, len(kinds))
        made = kinds[m.topic]()
        _fill(made, m.value)
        writer.write_message(m.topic, made, m.t_ns, m.t_ns if m.publish_ns is None else m.publish_ns, k)
    writer.finish()


_WRITERS = {"json": _write_json, "cdr": _write_cdr, "protobuf": _write_protobuf}


def _plain(value):
    if isinstance(value, Stamp):
        return value._asdict()
    if isinstance(value, Mapping):
        return {name: _plain(child) for name, child in value.items()}
    return value


def _json_schema(value):
    if isinstance(value, Stamp):
        return _json_schema(value._asdict())
    if isinstance(value, Mapping):
        return {"type": "object", "properties": {n: _json_schema(v) for n, v in value.items()}}
    if isinstance(value, list):
        return {"type": "array", "items": _json_schema(value[0])}
    return {"type": "string" if isinstance(value, str) else "number"}


def _ros2_text(value: Mapping[str, Any], name: str) -> str:
    lines, nested = ["# what a magnet says of itself", "uint8 MODE_OFF=0"], []
    for field, child in value.items():
        if isinstance(child, Stamp):
            lines.append(f"builtin_interfaces/Time {field}")
        elif isinstance(child, Mapping):
            kind = f"{name}{field.title()}"
            lines.append(f"test_msgs/{kind} {field}")
            nested.append("=" * 80 + f"\nMSG: test_msgs/{kind}\n" + _ros2_text(child, kind))
        elif isinstance(child, list):
            lines.append(f"float64[{len(child)}] {field}")
        else:
            lines.append(f"{'string' if isinstance(child, str) else 'float64'} {field}  # as it comes")
    return "\n".join([*lines, *nested])


def _protobuf_class(value: Mapping[str, Any], number: int) -> Any:
    from google.protobuf import timestamp_pb2

    pool = DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    file = FileDescriptorProto(name=f"state{number}.proto", package=f"test{number}", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    _add_type(file.message_type.add(name="State"), value, f".test{number}.State")
    pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(f"test{number}.State"))


def _add_type(kind: Any, value: Mapping[str, Any], full_name: str) -> None:
    F = FieldDescriptorProto
    for k, (name, child) in enumerate(value.items(), start=1):
        field = kind.field.add(name=name, number=k, label=F.LABEL_OPTIONAL, type=F.TYPE_DOUBLE)
        if isinstance(child, Stamp):
            field.type, field.type_name = F.TYPE_MESSAGE, ".google.protobuf.Timestamp"
        elif isinstance(child, Mapping):
            field.type, field.type_name = F.TYPE_MESSAGE, f"{full_name}.{name.title()}"
            _add_type(kind.nested_type.add(name=name.title()), child, field.type_name)
        elif isinstance(child, list):
            field.label = F.LABEL_REPEATED
        elif isinstance(child, str):
            field.type = F.TYPE_STRING


def _fill(made: Any, value: Mapping[str, Any]) -> None:
    for name, child in value.items():
        if isinstance(child, Stamp):
            getattr(made, name).seconds, getattr(made, name).nanos = child
        elif isinstance(child, Mapping):
            getattr(made, name).SetInParent()
            _fill(getattr(made, name), child)
        elif isinstance(child, list):
            getattr(made, name).extend(child)
        else:
            setattr(made, name, child)
