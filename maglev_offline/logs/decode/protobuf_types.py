"""From a protobuf descriptor set to a plan of how each message type lies in its bytes."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property
from graphlib import TopologicalSorter
from itertools import accumulate, groupby
from typing import Any

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from numpy.typing import NDArray

from maglev_offline.logs.schema_fields import TIME_PARTS

MOST_FIELDS = 4096
"""Types of which more fields can be reached are left to the library."""


class Kind(Enum):
    """How a field's value lies in the bytes."""

    INT32 = auto()
    INT64 = auto()
    UINT32 = auto()
    UINT64 = auto()
    SINT32 = auto()
    SINT64 = auto()
    BOOL = auto()
    ENUM = auto()
    FIXED32 = auto()
    FIXED64 = auto()
    SFIXED32 = auto()
    SFIXED64 = auto()
    FLOAT = auto()
    DOUBLE = auto()
    TEXT = auto()
    BYTES = auto()
    MESSAGE = auto()


FIXED: dict[Kind, np.dtype[Any]] = {
    Kind.FIXED32: np.dtype("<u4"),
    Kind.FIXED64: np.dtype("<u8"),
    Kind.SFIXED32: np.dtype("<i4"),
    Kind.SFIXED64: np.dtype("<i8"),
    Kind.FLOAT: np.dtype("<f4"),
    Kind.DOUBLE: np.dtype("<f8"),
}
_BY_LENGTH = (Kind.TEXT, Kind.BYTES, Kind.MESSAGE)
NO_NUMBER = (Kind.BOOL, *_BY_LENGTH)
_NOT_INTEGER = (Kind.FLOAT, Kind.DOUBLE, *_BY_LENGTH)
_KINDS = {
    FieldDescriptor.TYPE_INT32: Kind.INT32,
    FieldDescriptor.TYPE_INT64: Kind.INT64,
    FieldDescriptor.TYPE_UINT32: Kind.UINT32,
    FieldDescriptor.TYPE_UINT64: Kind.UINT64,
    FieldDescriptor.TYPE_SINT32: Kind.SINT32,
    FieldDescriptor.TYPE_SINT64: Kind.SINT64,
    FieldDescriptor.TYPE_BOOL: Kind.BOOL,
    FieldDescriptor.TYPE_ENUM: Kind.ENUM,
    FieldDescriptor.TYPE_FIXED32: Kind.FIXED32,
    FieldDescriptor.TYPE_FIXED64: Kind.FIXED64,
    FieldDescriptor.TYPE_SFIXED32: Kind.SFIXED32,
    FieldDescriptor.TYPE_SFIXED64: Kind.SFIXED64,
    FieldDescriptor.TYPE_FLOAT: Kind.FLOAT,
    FieldDescriptor.TYPE_DOUBLE: Kind.DOUBLE,
    FieldDescriptor.TYPE_STRING: Kind.TEXT,
    FieldDescriptor.TYPE_BYTES: Kind.BYTES,
    FieldDescriptor.TYPE_MESSAGE: Kind.MESSAGE,
}


@dataclass(frozen=True)
class FieldPlan:
    """One field: its tag as the little-endian number that its `tag_bytes` make, and how its values are coded.

    `oneof` names the oneof of several fields that it belongs to; `known` holds the values of a closed enum.
    """

    name: str
    number: int
    tag: int
    tag_bytes: int
    kind: Kind
    repeated: bool
    packed: bool
    presence: bool
    required: bool
    default: int
    message: str = ""
    oneof: str = ""
    known: NDArray[np.int64] | None = None


@dataclass(frozen=True)
class MessagePlan:
    """The fields of one message type in the order of their numbers, which is that of serialisers.

    A field of a kind that the cursor does not read (a group) is left out: a message that holds one does not fit.
    `head` is the width of a read that takes in every tag.
    """

    name: str
    fields: tuple[FieldPlan, ...]
    head: np.dtype[np.unsignedinteger]
    is_map_entry: bool
    time: tuple[FieldPlan, FieldPlan] | None

    @cached_property
    def by_name(self) -> dict[str, FieldPlan]:
        """The fields by name."""
        return {f.name: f for f in self.fields}

    @cached_property
    def needs_all(self) -> bool:
        """Whether a message without a certain field is not complete."""
        return any(f.required for f in self.fields)

    @cached_property
    def runs(self) -> dict[int, "FixedRun"]:
        """Runs of at least two fields of fixed size, one after the other, by the place of the first in `fields`."""
        found: dict[int, FixedRun] = {}
        first = 0
        for fixed, group in groupby(self.fields, key=_takes_fixed_bytes):
            fields = tuple(group)
            if fixed and len(fields) > 1:
                sizes = [f.tag_bytes + FIXED[f.kind].itemsize for f in fields]
                found[first] = FixedRun(fields, tuple(accumulate(sizes, initial=0))[:-1], sum(sizes))
            first += len(fields)
        return found


@dataclass(frozen=True)
class FixedRun:
    """Fields of fixed size that lie side by side where none is left out: their `offsets`, and the `span` of all."""

    fields: tuple[FieldPlan, ...]
    offsets: tuple[int, ...]
    span: int


def _takes_fixed_bytes(field: FieldPlan) -> bool:
    return field.kind in FIXED and not field.repeated and not field.oneof and field.tag_bytes <= 2


def message_plans(schema_name: str, schema: bytes) -> dict[str, MessagePlan]:
    """Plans of the type and of every type that it reaches, by full name; raises what the descriptor pool raises."""
    return _messages(_root(schema_name, schema))


def _root(schema_name: str, schema: bytes) -> Descriptor:
    files = {file.name: file for file in FileDescriptorSet.FromString(schema).file}
    pool = DescriptorPool()
    needs = {name: [d for d in file.dependency if d in files] for name, file in files.items()}
    for name in TopologicalSorter(needs).static_order():
        pool.Add(files[name])
    root: Descriptor = pool.FindMessageTypeByName(schema_name)
    return root


def _messages(root: Descriptor) -> dict[str, MessagePlan]:
    """Plans of the root and of every type that it reaches.

    Raises
    ------
    ValueError: too many fields.
    """
    found: dict[str, MessagePlan] = {}
    ahead, fields = [root], 0
    while ahead:
        descriptor = ahead.pop()
        if descriptor.full_name in found:
            continue
        fields += len(descriptor.fields)
        if fields > MOST_FIELDS:
            raise ValueError("too many fields")
        found[descriptor.full_name] = _message(descriptor)
        ahead.extend(f.message_type for f in descriptor.fields if f.message_type is not None)
    return found


def _message(descriptor: Descriptor) -> MessagePlan:
    declared = sorted((f for f in descriptor.fields if f.type in _KINDS), key=lambda f: f.number)
    fields = tuple(_field(f) for f in declared)
    widest = max((f.tag_bytes for f in fields), default=1)
    head = np.dtype(f"<u{1 << (widest - 1).bit_length()}")
    is_map_entry = bool(descriptor.GetOptions().map_entry)
    return MessagePlan(descriptor.full_name, fields, head, is_map_entry, _time(descriptor, fields))


def _field(f: FieldDescriptor) -> FieldPlan:
    kind = _KINDS[f.type]
    packed = bool(f.is_repeated and f.is_packed)
    if packed or kind in _BY_LENGTH:
        wire_type = 2
    elif kind in FIXED:
        wire_type = 1 if FIXED[kind].itemsize == 8 else 5
    else:
        wire_type = 0
    coded = bytes(_varint(f.number << 3 | wire_type))
    closed = f.enum_type is not None and f.enum_type.is_closed
    oneof = f.containing_oneof
    return FieldPlan(
        name=f.name,
        number=f.number,
        tag=int.from_bytes(coded, "little"),
        tag_bytes=len(coded),
        kind=kind,
        repeated=f.is_repeated,
        packed=packed,
        presence=f.has_presence,
        required=f.is_required,
        default=0 if f.is_repeated or kind in _NOT_INTEGER else int(f.default_value),
        message="" if f.message_type is None else f.message_type.full_name,
        oneof=oneof.name if oneof is not None and len(oneof.fields) > 1 else "",
        known=np.array(sorted(f.enum_type.values_by_number), dtype=np.int64) if f.enum_type and closed else None,
    )


def _varint(value: int) -> Iterator[int]:
    while value > 0x7F:
        yield value & 0x7F | 0x80
        value >>= 7
    yield value


def _time(descriptor: Descriptor, fields: tuple[FieldPlan, ...]) -> tuple[FieldPlan, FieldPlan] | None:
    """The pair of fields that makes this message a time, as the library's reading finds it.

    Raises
    ------
    ValueError: an enum value has the name of such a part, and Python finds it in the message.
    """
    by_name = {f.name: f for f in fields if not f.repeated and f.kind not in _NOT_INTEGER}
    if any(part in descriptor.enum_values_by_name for pair in TIME_PARTS for part in pair):
        raise ValueError("an enum value is named as the part of a time")
    for whole, rest in TIME_PARTS:
        if whole in by_name and rest in by_name:
            return by_name[whole], by_name[rest]
    return None
