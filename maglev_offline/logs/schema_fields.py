"""The numeric fields and time stamps that a channel's schema declares, as dotted paths.

An element of a list of fixed length has its index in the path (`magnets.2.gap`); a list of unknown length is written
with a star (`magnets.*.gap`), which stands for any index.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

_DEEPEST = 10
"""Schemas may refer to themselves; deeper than this nobody looks for a signal."""

_LONGEST_LIST = 16
"""A longer list of fixed length is written with a star."""

TIME_PARTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
"""How the encodings spell a time: whole seconds, then nanoseconds."""


class DeclaredFields(NamedTuple):
    """Dotted paths of the numeric fields, and of the time stamps (which are also numeric: their two parts)."""

    numbers: tuple[str, ...]
    times: tuple[str, ...]


NOTHING = DeclaredFields((), ())


def declared_fields(schema_encoding: str, schema_name: str, data: bytes) -> DeclaredFields:
    """Read a schema; one that cannot be read declares nothing.

    `schema_encoding` is `ros2msg`, `ros1msg`, `jsonschema` or `protobuf`; every other declares nothing.
    """
    try:
        match schema_encoding:
            case "ros2msg":
                leaves = _ros2_leaves(schema_name, data.decode())
            case "ros1msg":
                leaves = _ros1_leaves(schema_name, data.decode())
            case "jsonschema":
                leaves = _json_schema_leaves(json.loads(data or b"{}"))
            case "protobuf":
                leaves = _protobuf_leaves(schema_name, data)
            case _:
                return NOTHING
        return collect(leaves)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return NOTHING


def fields_of_value(value: Any) -> DeclaredFields:
    """Fields of one decoded JSON message, for a channel without a schema; null counts as a number that is missing."""
    return collect(_value_leaves(value, ""))


def collect(leaves: Iterator[str]) -> DeclaredFields:
    """Order as declared, each path once; a pair of time parts under one parent makes that parent a time."""
    numbers = tuple(dict.fromkeys(leaves))
    known = set(numbers)
    parents = dict.fromkeys(path.rpartition(".")[0] for path in numbers)
    times = tuple(p for p in parents if p and any({f"{p}.{a}", f"{p}.{b}"} <= known for a, b in TIME_PARTS))
    return DeclaredFields(numbers, times)


def declares(declared: tuple[str, ...], path: str) -> bool:
    """Whether `path` is among the declared paths, where a star stands for any index."""
    if path in declared:
        return True
    parts = path.split(".")
    return any("*" in d and _same(d.split("."), parts) for d in declared)


def _same(pattern: list[str], parts: list[str]) -> bool:
    return len(pattern) == len(parts) and all(
        p == q or (p == "*" and q.isdigit()) for p, q in zip(pattern, parts, strict=True)
    )


def _below(parent: str, name: str) -> str:
    return f"{parent}.{name}" if parent else name


_ROS2_NUMBERS = frozenset(
    "byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64".split()  # noqa: SIM905
)


def _ros1_leaves(name: str, text: str) -> Iterator[str]:
    """In ROS 1 the times are primitives, whose parts have names of their own."""
    return _ros_leaves(name, text, ("time", "duration"), [("uint32", "secs"), ("uint32", "nsecs")])


def _ros2_leaves(name: str, text: str) -> Iterator[str]:
    times = ("builtin_interfaces/Time", "builtin_interfaces/Duration")
    return _ros_leaves(name, text, times, [("int32", "sec"), ("uint32", "nanosec")])


def _ros_leaves(name: str, text: str, times: tuple[str, ...], parts: list[tuple[str, str]]) -> Iterator[str]:
    definitions = dict.fromkeys(times, parts)
    current = _ros2_short(name)
    definitions[current] = []
    for raw in text.splitlines():
        line = raw.partition("#")[0].strip()
        if line.startswith("MSG:"):
            current = _ros2_short(line.removeprefix("MSG:").strip())
            definitions[current] = []
        elif line and not line.startswith("==="):
            kind, _, rest = line.partition(" ")
            member = rest.split()[0] if rest.split() else ""
            # `uint8 MODE=1` and `uint8 MODE = 1` are constants: they are in no message.
            if member and "=" not in member and not rest.split(member, 1)[1].strip().startswith("="):
                definitions[current].append((kind, member))
    return _ros2_walk(definitions, _ros2_short(name), "", 0)


def _ros2_short(name: str) -> str:
    """`std_msgs/msg/Header` and `std_msgs/Header` are the same type."""
    return f"{name.split('/')[0]}/{name.split('/')[-1]}"


def _ros2_walk(definitions: dict[str, list[tuple[str, str]]], name: str, parent: str, depth: int) -> Iterator[str]:
    if depth > _DEEPEST:
        return
    for kind, member in definitions.get(name, []):
        base, bracket, length = kind.partition("[")
        paths = [_below(parent, member)]
        if bracket:
            size = length.rstrip("]")
            fixed = size.isdigit() and int(size) <= _LONGEST_LIST
            paths = [f"{paths[0]}.{k}" for k in range(int(size))] if fixed else [f"{paths[0]}.*"]
        for path in paths:
            if base in _ROS2_NUMBERS:
                yield path
            elif base in definitions:
                yield from _ros2_walk(definitions, base, path, depth + 1)
            elif "/" in base:
                yield from _ros2_walk(definitions, _ros2_short(base), path, depth + 1)
            elif base[:1].isupper():
                package = "std_msgs" if base == "Header" else name.split("/")[0]
                yield from _ros2_walk(definitions, f"{package}/{base}", path, depth + 1)


def _json_schema_leaves(schema: Mapping[str, Any]) -> Iterator[str]:
    return _json_schema_walk(schema, schema, "", 0)


def _json_schema_walk(root: Mapping[str, Any], node: Mapping[str, Any], parent: str, depth: int) -> Iterator[str]:
    if depth > _DEEPEST:
        return
    reference = node.get("$ref")
    if isinstance(reference, str) and reference.startswith("#/"):
        target: Any = root
        for part in reference[2:].split("/"):
            target = target[part]
        yield from _json_schema_walk(root, target, parent, depth + 1)
        return
    kind = node.get("type", "object" if "properties" in node else None)
    kinds = set(kind) if isinstance(kind, list) else {kind}
    if kinds & {"number", "integer"} and parent:
        yield parent
    if "object" in kinds:
        for name, child in node.get("properties", {}).items():
            yield from _json_schema_walk(root, child, _below(parent, name), depth + 1)
    if "array" in kinds and isinstance(node.get("items"), Mapping):
        yield from _json_schema_walk(root, node["items"], _below(parent, "*"), depth + 1)


def _protobuf_leaves(name: str, data: bytes) -> Iterator[str]:
    from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorSet
    from google.protobuf.message import DecodeError

    try:
        files = FileDescriptorSet.FromString(data)
    except DecodeError as error:
        raise ValueError(str(error)) from None
    types: dict[str, DescriptorProto] = {}

    def register(prefix: str, message: DescriptorProto) -> None:
        types[f"{prefix}.{message.name}"] = message
        for nested in message.nested_type:
            register(f"{prefix}.{message.name}", nested)

    for file in files.file:
        for message in file.message_type:
            register(f".{file.package}" if file.package else "", message)
    return _protobuf_walk(types, f".{name}", "", 0)


def _protobuf_walk(types: Mapping[str, Any], name: str, parent: str, depth: int) -> Iterator[str]:
    from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Kind

    if depth > _DEEPEST or name not in types or types[name].options.map_entry:
        return
    other = {Kind.TYPE_STRING, Kind.TYPE_BYTES, Kind.TYPE_BOOL, Kind.TYPE_ENUM, Kind.TYPE_GROUP}
    for field in types[name].field:
        path = _below(parent, field.name) + (".*" if field.label == Kind.LABEL_REPEATED else "")
        if field.type == Kind.TYPE_MESSAGE:
            yield from _protobuf_walk(types, field.type_name, path, depth + 1)
        elif field.type not in other:
            yield path


def _value_leaves(value: Any, parent: str, depth: int = 0) -> Iterator[str]:
    if depth > _DEEPEST or isinstance(value, bool):
        return
    if isinstance(value, dict):
        for name, child in value.items():
            yield from _value_leaves(child, _below(parent, name), depth + 1)
    elif isinstance(value, list):
        for k, child in enumerate(value[:_LONGEST_LIST]):
            yield from _value_leaves(child, _below(parent, str(k)), depth + 1)
    elif (value is None or isinstance(value, int | float)) and parent:
        yield parent
