"""What becomes of each field of a protobuf message: the wanted paths laid over the plans of the message types."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from maglev_offline.logs.decode.payloads import Path, Wanted
from maglev_offline.logs.decode.protobuf_types import NO_NUMBER, Kind, MessagePlan, message_plans

LARGEST_SCHEMA_BYTES = 16 * 2**20
"""A larger schema is left to the library."""


@dataclass
class Want:
    """What becomes of one field's value, and of those below it.

    `values` are rows of the result; `clock`: it is the stamp; `parts`: slots where whole seconds or nanoseconds wait
    for each other; `time`: the two slots of a message that is a time. `fields` [number] lead on into a message,
    `elements` [index] into a list. `defaults` [number]: what becomes of a field of this message that is left out.
    """

    values: list[int] = field(default_factory=list)
    clock: bool = False
    parts: list[int] = field(default_factory=list)
    time: tuple[int, int] | None = None
    fields: dict[int, "Want"] = field(default_factory=dict)
    elements: dict[int, "Want"] = field(default_factory=dict)
    defaults: dict[int, list["Default"]] = field(default_factory=dict)


class Default(NamedTuple):
    """The value of a field that is left out, and where it goes."""

    want: Want
    value: int


@dataclass(frozen=True)
class Plan:
    """All message types by full name, the root's name, what is wanted, the time slots, and the unit of the clock."""

    messages: dict[str, MessagePlan]
    root: str
    want: Want
    slots: int
    ns_per_unit: float


def plan_protobuf(schema_name: str, schema: bytes, wanted: Wanted) -> Plan | None:
    """The plan, or None where the schema or a path is beyond it (the library then says what is the matter)."""
    if len(schema) > LARGEST_SCHEMA_BYTES:
        return None
    clock = wanted.clock
    if clock is not None and not (math.isfinite(clock.ns_per_unit) and 0 < clock.ns_per_unit < 1e18):
        return None
    try:
        return _with_wants(message_plans(schema_name, schema), schema_name, wanted)
    except Exception:  # a descriptor pool has no list of what it raises, and the schema is not ours
        return None


def _with_wants(messages: dict[str, MessagePlan], root: str, wanted: Wanted) -> Plan:
    want, slots = Want(), 0
    targets: list[tuple[Path, int | None]] = [(path, row) for row, path in enumerate(wanted.paths)]
    if wanted.clock is not None:
        targets.append((tuple(wanted.clock.path.split(".")), None))
    for path, row in targets:
        found = _follow(messages, messages[root], want, path)
        if found is None:
            continue
        leaf, message = found
        if row is None:
            leaf.clock = True
        else:
            leaf.values.append(row)
        if message is not None and message.time is not None and leaf.time is None:
            leaf.time = (slots, slots + 1)
            for slot, part in zip(leaf.time, message.time, strict=True):
                child = leaf.fields.setdefault(part.number, Want())
                child.parts.append(slot)
                leaf.defaults.setdefault(part.number, []).append(Default(Want(parts=[slot]), part.default))
            slots += 2
    return Plan(messages, root, want, slots, 1e9 if wanted.clock is None else wanted.clock.ns_per_unit)


def _follow(
    messages: dict[str, MessagePlan], message: MessagePlan, want: Want, path: Path
) -> tuple[Want, MessagePlan | None] | None:
    """The end of a path, and the type there if it is a message; None where no message can hold a number there.

    Raises
    ------
    ValueError: the path steps below a plain value or a map, where the library's reading has its own ways.
    """
    parts = list(path)
    while parts:
        declared = message.by_name.get(parts.pop(0))
        if declared is None:
            return None
        child = want.fields.setdefault(declared.number, Want())
        if declared.repeated:
            if not parts:
                return None
            index = parts.pop(0)
            if not (index.isascii() and index.isdigit() and len(index) < 10):
                raise ValueError("no index of a list")
            child = child.elements.setdefault(int(index), Want())
        if declared.kind is Kind.MESSAGE:
            message, want = messages[declared.message], child
            if message.is_map_entry:
                raise ValueError("a path into a map")
            continue
        if parts:
            raise ValueError("a path below a plain value")
        if declared.kind in NO_NUMBER:
            return None
        known = want.defaults.setdefault(declared.number, [])
        if not declared.presence and not declared.repeated and all(d.want is not child for d in known):
            known.append(Default(child, 0))
        return child, None
    return want, message
