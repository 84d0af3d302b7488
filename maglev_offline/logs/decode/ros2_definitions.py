"""ROS 2 message definitions (`ros2msg` schemas) as a tree of types, read as the library's decoder reads them.

Where the library refuses a definition (a bad name, a default value out of range) this reader need not: the ladder
asks the library first. What this reader accepts has the same members in the same order.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

_DEEPEST = 32
_MOST_FIELDS = 10_000
_LONGEST_TEXT = 4_000_000
"""Definitions beyond these limits go to the library: to unfold a hostile one could take for ever."""


@dataclass(frozen=True)
class Primitive:
    """A number or a truth value; `code` is its numpy type without the byte order: kind, then size in bytes."""

    code: str

    @property
    def size(self) -> int:
        """Bytes, which are also its alignment."""
        return int(self.code[1:])

    @property
    def truth(self) -> bool:
        """Whether it is a truth value, which is no number."""
        return self.code[0] == "b"

    @property
    def whole(self) -> bool:
        """Whether Python sees an int (a truth value is one)."""
        return self.code[0] in "biu"


@dataclass(frozen=True)
class Text:
    """A string of UTF-8."""


@dataclass(frozen=True)
class Listed:
    """An array of `count` elements; a sequence, whose length each message tells, where it is None."""

    element: "Kind"
    count: int | None


@dataclass(frozen=True)
class Struct:
    """A message type; without members it still takes one byte."""

    members: tuple[tuple[str, "Kind"], ...]


Kind = Primitive | Text | Listed | Struct

_PRIMITIVES = {
    "bool": Primitive("b1"),
    "byte": Primitive("u1"),
    "char": Primitive("i1"),
    "float32": Primitive("f4"),
    "float64": Primitive("f8"),
    **{f"int{8 * size}": Primitive(f"i{size}") for size in (1, 2, 4, 8)},
    **{f"uint{8 * size}": Primitive(f"u{size}") for size in (1, 2, 4, 8)},
}

_UNREADABLE = frozenset({"wstring", "time", "duration"})
"""Known to the language, but the library decodes no message that holds one."""


@dataclass(frozen=True)
class Member:
    """One line of a definition: `kind` as written, without its bounds; `count` as in `Listed`."""

    name: str
    kind: str
    listed: bool
    count: int | None


Definitions = dict[str, tuple[str, tuple[Member, ...]]]
"""Package and members of each type, by its name."""

_TIME = (Member("sec", "uint32", False, None), Member("nanosec", "uint32", False, None))
"""The library's own notion of a time where the schema brings none; by ROS 2 its seconds are signed."""

_TYPE = re.compile(r"(?P<kind>\w+(?:/\w+)?)(?P<bound><=\d+)?(?P<list>\[(?:(?P<most><=)?(?P<count>\d+))?\])?", re.ASCII)
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)
_SEPARATOR = re.compile(r"={3,}")
_SECTION_NAME = re.compile(r"MSG:\s+(\S+)", re.ASCII)


def read_message_type(schema_name: str, schema: bytes) -> Struct:
    """Read a schema and unfold its message type.

    Raises
    ------
    ValueError: a line that cannot be read, a type that is not defined, that the library does not decode, or that
        holds itself; more than 32 types deep or more than 10,000 fields (elements of arrays of types counted one
        by one).
    """
    if len(schema) > _LONGEST_TEXT:
        raise ValueError("the schema is too long")
    definitions = read_definitions(schema_name, schema.decode())
    if schema_name not in definitions:
        raise ValueError(f"the schema does not define {schema_name}")
    return _Unfolding(definitions).struct(schema_name, 0)


def read_definitions(schema_name: str, text: str) -> Definitions:
    """Package and members of each type, by the name as written and by `package/Name`; the last of a name counts.

    A section without a `MSG:` line bears the name of the one before it, as in the library.
    """
    found: Definitions = {f"builtin_interfaces/{name}": ("builtin_interfaces", _TIME) for name in ("Time", "Duration")}
    name, fields = schema_name, 0
    for section in _sections(text):
        lines = section
        if lines and (match := _SECTION_NAME.fullmatch(lines[0])):
            name, lines = match[1], lines[1:]
        package, _, rest = name.partition("/")
        members = tuple(_members(lines))
        fields += len(members)
        if fields > _MOST_FIELDS:
            raise ValueError("the schema has too many fields")
        found[name] = found[f"{package}/{rest.rpartition('/')[2] or package}"] = (package, members)
    return found


def _sections(text: str) -> list[list[str]]:
    sections: list[list[str]] = [[]]
    for line in text.splitlines():
        if _SEPARATOR.fullmatch(line):
            sections.append([])
        elif line.strip():
            sections[-1].append(line)
    for section in sections:
        if section:
            # The library strips whole sections: only their first line may be indented.
            section[0] = section[0].lstrip()
            section[-1] = section[-1].rstrip()
    return sections


def _members(lines: Iterable[str]) -> Iterable[Member]:
    names = set()
    for raw in lines:
        line = raw.replace("\t", " ").partition("#")[0].rstrip()
        if not line:
            continue
        kind, _, rest = line.partition(" ")
        if "=" in rest:
            continue  # a constant, which is in no message
        words = rest.split()
        match = _TYPE.fullmatch(kind)
        if match is None or not words or not _NAME.fullmatch(words[0]) or words[0] in names:
            raise ValueError(f"{line[:80]!r} is no field")
        if match["bound"] and match["kind"] not in {"string", "wstring"}:
            raise ValueError(f"{line[:80]!r}: only strings are bounded so")
        count = int(match["count"]) if match["count"] and len(match["count"]) < 12 else None
        if count == 0 or (match["count"] and count is None):
            raise ValueError(f"{line[:80]!r}: no array is of this size")
        names.add(words[0])
        yield Member(words[0], match["kind"], bool(match["list"]), None if match["most"] else count)


class _Unfolding:
    """Resolves the names of types; each type is unfolded once, however often it is used."""

    def __init__(self, definitions: Definitions) -> None:
        self._definitions = definitions
        self._done: dict[str, tuple[Struct, int, int]] = {}
        self._open: set[str] = set()

    def struct(self, name: str, depth: int) -> Struct:
        return self._unfold(name, depth)[0]

    def _unfold(self, name: str, depth: int) -> tuple[Struct, int, int]:
        """The type, its number of fields, and how many types deep it is."""
        if name in self._done:
            return self._done[name]
        if name in self._open or name not in self._definitions or depth > _DEEPEST:
            raise ValueError(f"type {name} is not defined, holds itself or lies too deep")
        self._open.add(name)
        package, declared = self._definitions[name]
        members, fields, height = [], 1, 1
        for member in declared:
            kind, inside, below = self._kind(package, member, depth)
            members.append((member.name, kind))
            fields, height = fields + inside, max(height, below + 1)
            if fields > _MOST_FIELDS or height > _DEEPEST:
                raise ValueError(f"type {name} has too many fields or is too deep")
        self._open.remove(name)
        self._done[name] = Struct(tuple(members)), fields, height
        return self._done[name]

    def _kind(self, package: str, member: Member, depth: int) -> tuple[Kind, int, int]:
        if member.kind in _UNREADABLE:
            raise ValueError(f"the library does not decode {member.kind}")
        single: Kind
        single, fields, height = Text(), 1, 0
        if member.kind in _PRIMITIVES:
            single = _PRIMITIVES[member.kind]
        elif member.kind != "string":
            full = member.kind if "/" in member.kind else f"{package}/{member.kind}"
            single, fields, height = self._unfold(full, depth + 1)
        if not member.listed:
            return single, fields, height
        # An array of numbers is one field; of other things each element has its own place in the plan.
        times = 1 if isinstance(single, Primitive) else member.count or 1
        return Listed(single, member.count), fields * times, height
