"""Random ROS 2 message types with their values, and an encoder of either byte order that is the test's own."""

import struct
from typing import Any, NamedTuple

from hypothesis import strategies as st

FORMATS = {
    "bool": "?", "byte": "B", "char": "b", "float32": "f", "float64": "d", "int8": "b", "uint8": "B", "int16": "h",
    "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q",
}  # fmt: skip
TIME = "builtin_interfaces/Time"


class Field(NamedTuple):
    """A member: `listed` is None (single), `fixed`, `bounded` or `free`; `count` of an array or the bound of it."""

    name: str
    kind: str
    listed: str | None = None
    count: int = 0

    @property
    def line(self) -> str:
        brackets = {None: "", "fixed": f"[{self.count}]", "bounded": f"[<={self.count}]", "free": "[]"}
        return f"{self.kind}{brackets[self.listed]} {self.name}"


Types = dict[str, list[Field]]
"""Members by `package/Name`; the first is the message itself."""


def schema_text(types: Types) -> str:
    sections = ["\n".join(["# a comment", "uint8 MODE=1", *(f.line for f in fields)]) for fields in types.values()]
    names = list(types)
    return sections[0] + "".join(
        f"\n{'=' * 80}\nMSG: {name}\n{section}" for name, section in zip(names[1:], sections[1:], strict=True)
    )


@st.composite
def message_types(draw: st.DrawFn, *, fixed: bool = False) -> Types:
    """Up to four types, of which each may hold those behind it."""
    count = draw(st.integers(1, 4))
    types: Types = {}
    for k in range(count):
        inner = [f"test_msgs/T{j}" for j in range(k + 1, count)]
        singles = [*FORMATS, TIME, "builtin_interfaces/Duration", *inner, *inner]
        kinds = st.sampled_from(singles if fixed else [*singles, "string", "string", "string<=5"])
        fields = []
        for n in range(draw(st.integers(0 if k else 1, 5))):
            listed = draw(st.sampled_from([None, None, "fixed"] if fixed else [None, None, "fixed", "bounded", "free"]))
            fields.append(Field(f"f{n}", draw(kinds), listed, draw(st.integers(1, 3))))
        if draw(st.integers(0, 4)) == 0:
            whole = st.sampled_from(["bool", "int8", "int32", "uint32", "int64", "uint64", "float64"])
            fields += [Field("sec", draw(whole)), Field("nanosec", draw(whole))]
        types[f"test_msgs/T{k}"] = fields
    return types


def _single(types: Types, kind: str) -> st.SearchStrategy[Any]:
    if kind == "bool":
        return st.booleans()
    if kind == "float32":
        return st.floats(width=32)
    if kind == "float64":
        return st.floats()
    if kind.startswith("string"):
        most = 5 if "<=" in kind else 12
        return st.text(max_size=most) | st.text("abcdef_/", max_size=3 * most)
    if kind in FORMATS:
        size = 8 * struct.calcsize(FORMATS[kind])
        signed = FORMATS[kind].islower()
        low, high = (-(2 ** (size - 1)), 2 ** (size - 1) - 1) if signed else (0, 2**size - 1)
        return st.integers(low, high) | st.sampled_from([low, high, high - 1, high // 3])
    return values(types, kind)


def values(types: Types, name: str) -> st.SearchStrategy[dict[str, Any]]:
    """Values of one type as nested dicts and lists."""
    if name in {TIME, "builtin_interfaces/Duration"}:
        part = st.integers(0, 2**32 - 1)
        return st.fixed_dictionaries({"sec": part, "nanosec": part})
    members = {}
    for field in types[name]:
        one = _single(types, field.kind)
        match field.listed:
            case None:
                members[field.name] = one
            case "fixed":
                members[field.name] = st.lists(one, min_size=field.count, max_size=field.count)
            case "bounded":
                members[field.name] = st.lists(one, max_size=field.count)
            case _:
                members[field.name] = st.lists(one, max_size=4)
    return st.fixed_dictionaries(members)


def paths(types: Types, name: str) -> list[tuple[str, ...]]:
    """All that a path can lead to, some lists' elements that may be missing, and names that are nowhere."""
    found: list[tuple[str, ...]] = []

    def walk(kind: str, here: tuple[str, ...]) -> None:
        found.append(here)
        if kind in FORMATS or kind.startswith("string"):
            found.extend([(*here, "0"), (*here, "nowhere"), (*here, "hex")])
        if kind in {TIME, "builtin_interfaces/Duration"}:
            found.extend([(*here, "sec"), (*here, "nanosec")])
        elif kind in types:
            found.append((*here, "nowhere"))
            for field in types[kind]:
                if field.listed is None:
                    walk(field.kind, (*here, field.name))
                else:
                    found.append((*here, field.name))
                    for k in (0, 1, 3):
                        walk(field.kind, (*here, field.name, str(k)))

    walk(name, ())
    return found


def encode(types: Types, name: str, value: dict[str, Any], order: str) -> bytes:
    """A payload with its encapsulation; `order` is `<` or `>`."""
    body = bytearray()

    def number(kind: str, one: Any) -> None:
        size = struct.calcsize(FORMATS[kind])
        body.extend(bytes(-len(body) % size))
        body.extend(struct.pack(order + FORMATS[kind], one))

    def single(kind: str, one: Any) -> None:
        if kind.startswith("string"):
            text = one.encode() + b"\0"
            number("uint32", len(text))
            body.extend(text)
        elif kind in FORMATS:
            number(kind, one)
        elif kind in types:
            message(types[kind], one)
        else:
            message([Field("sec", "uint32"), Field("nanosec", "uint32")], one)

    def message(fields: list[Field], one: dict[str, Any]) -> None:
        if not fields:
            number("uint8", 0)
        for field in fields:
            if field.listed is None:
                single(field.kind, one[field.name])
                continue
            if field.listed != "fixed":
                number("uint32", len(one[field.name]))
            for element in one[field.name]:
                single(field.kind, element)

    message(types[name], value)
    return bytes([0, 1 if order == "<" else 0, 0, 0]) + bytes(body)
