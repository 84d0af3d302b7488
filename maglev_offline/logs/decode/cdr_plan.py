"""From a message type and the wanted paths to the steps that read them.

A slot is one primitive value of the message that some path needs; a path has one slot, a time has two.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from maglev_offline.logs.decode.payloads import Path
from maglev_offline.logs.decode.ros2_definitions import Kind, Listed, Primitive, Struct, Text
from maglev_offline.logs.schema_fields import TIME_PARTS

_MOST_STEPS = 20_000
_LONGEST_MESSAGE = 2**40
_WIDEST_GAP, _WIDEST_CLUSTER = 64, 512
"""Wanted values that lie closer than this [bytes] are fetched together, so much at a time."""

_PARTS_OF_A_NUMBER = frozenset({"real", "imag", "numerator", "denominator"})

Place = tuple[str | int, ...]
"""Names of members and numbers of elements, down to a primitive."""


class Number(NamedTuple):
    """A path that leads to a number."""

    slot: int


class Time(NamedTuple):
    """A path that leads to a time: whole seconds and nanoseconds."""

    seconds: int
    nanoseconds: int


Source = Number | Time | None
"""Where a path finds its value; None where there is none, or none that is a number."""


class Cluster(NamedTuple):
    """Wanted values that lie close together: from `first` on, `span` bytes; `fields` are (slot, byte in it, code)."""

    first: int
    span: int
    fields: tuple[tuple[int, int, str], ...]


class Layout(NamedTuple):
    """A run of fields of fixed size: its bytes, and what to take out of them."""

    size: int
    clusters: tuple[Cluster, ...]


@dataclass(frozen=True)
class Segment:
    """A run of fields of fixed size; a layout for each position that it may begin at, modulo their number."""

    layouts: tuple[Layout, ...]


@dataclass(frozen=True)
class String:
    """One string."""


@dataclass(frozen=True)
class Numbers:
    """A sequence of primitives; `taken` are (element, slot), elements rising."""

    code: str
    size: int
    taken: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Repeat:
    """A sequence of other things: the steps of an element, and those of the elements that hold something wanted."""

    plain: tuple["Step", ...]
    special: dict[int, tuple["Step", ...]]


Step = Segment | String | Numbers | Repeat


class _Run(NamedTuple):
    """An array of primitives (a single one is an array of one), before it goes into a segment."""

    code: str
    size: int
    elements: int
    taken: tuple[tuple[int, int], ...]


Asked = dict[str | int, "Asked | int"]
"""The places of the slots as a tree."""


def find(top: Struct, path: Path, slots: dict[Place, int]) -> Source:
    """Follow a path as `value_at` and `number` do; `slots` gains the places that it needs.

    Raises
    ------
    ValueError: the path leads into what a Python object has besides its fields (`gap.real`, `__dict__`).
    """
    kind: Kind = top
    place: Place = ()
    for part in path:
        if part.startswith("_") or (part.isdigit() and not (part.isascii() and len(part) < 18)):
            raise ValueError(f"{part[:20]!r} is the name of no member")
        if isinstance(kind, Struct):
            inside = dict(kind.members).get(part)
        elif isinstance(kind, Listed) and part.isdigit():
            inside = kind.element if kind.count is None or int(part) < kind.count else None
        elif isinstance(kind, Primitive) and part in _PARTS_OF_A_NUMBER:
            raise ValueError(f"{part} is a member of a number in Python only")
        else:
            inside = None
        if inside is None:
            return None
        place = (*place, part if isinstance(kind, Struct) else int(part))
        kind = inside

    def slot(*below: str) -> int:
        return slots.setdefault((*place, *below), len(slots))

    if isinstance(kind, Primitive) and not kind.truth:
        return Number(slot())
    if isinstance(kind, Struct):
        known = dict(kind.members)
        for whole, rest in TIME_PARTS:
            if all(isinstance(known.get(p), Primitive) and known[p].whole for p in (whole, rest)):  # type: ignore[union-attr]
                return Time(slot(whole), slot(rest))
    return None


def make_steps(top: Struct, slots: dict[Place, int]) -> tuple[Step, ...]:
    """Return the steps that read a whole message, slots and all else.

    Raises
    ------
    ValueError: there would be too many of them, or the message would be too long.
    """
    asked: Asked = {}
    for place, slot in slots.items():
        node = asked
        for part in place[:-1]:
            below = node.setdefault(part, {})
            assert isinstance(below, dict), "only primitives have slots, and they have nothing below"
            node = below
        node[place[-1]] = slot
    return _Planner().steps(top, asked)


class _Planner:
    """Writes the steps down and counts them."""

    def __init__(self) -> None:
        self._written = 0

    def steps(self, kind: Kind, asked: Asked | int | None) -> tuple[Step, ...]:
        done: list[Step] = []
        runs: list[_Run] = []
        for piece in self._pieces(kind, asked):
            self._written += 1
            if self._written > _MOST_STEPS:
                raise ValueError("the message has too many parts")
            if isinstance(piece, _Run):
                runs.append(piece)
                continue
            if runs:
                done.append(_segment(runs))
                runs = []
            done.append(piece)
        if runs:
            done.append(_segment(runs))
        return tuple(done)

    def _pieces(self, kind: Kind, asked: Asked | int | None) -> Iterator[_Run | String | Numbers | Repeat]:
        below = asked if isinstance(asked, dict) else {}
        match kind:
            case Primitive(code):
                yield _Run(code, kind.size, 1, ((0, asked),) if isinstance(asked, int) else ())
            case Text():
                yield String()
            case Struct(members):
                if not members:
                    yield _Run("u1", 1, 1, ())
                for name, member in members:
                    yield from self._pieces(member, below.get(name))
            case Listed(Primitive(code) as element, count):
                taken = sorted((k, s) for k, s in below.items() if isinstance(k, int) and isinstance(s, int))
                if count is None:
                    yield Numbers(code, element.size, tuple(taken))
                else:
                    yield _Run(code, element.size, count, tuple(taken))
            case Listed(element, None):
                special = {k: self.steps(element, below[k]) for k in sorted(k for k in below if isinstance(k, int))}
                yield Repeat(self.steps(element, None), special)
            case Listed(element, int(count)):
                for k in range(count):
                    yield from self._pieces(element, below.get(k))


def _segment(runs: list[_Run]) -> Segment:
    widest = max(run.size for run in runs)
    return Segment(tuple(_layout(runs, phase) for phase in range(widest)))


def _layout(runs: list[_Run], phase: int) -> Layout:
    """Where everything lies from a beginning at `phase` on (modulo the widest field); each is aligned to its size."""
    at, fields = phase, []
    for run in runs:
        at = -(-at // run.size) * run.size
        fields += [(slot, at + k * run.size - phase, run.code, run.size) for k, slot in run.taken]
        at += run.size * run.elements
    if at > _LONGEST_MESSAGE:
        raise ValueError("the message is too long")
    clusters: list[Cluster] = []
    for slot, first, code, size in fields:
        old = clusters[-1] if clusters else None
        if old and first - old.first - old.span <= _WIDEST_GAP and first + size - old.first <= _WIDEST_CLUSTER:
            joined = (*old.fields, (slot, first - old.first, code))
            clusters[-1] = Cluster(old.first, first + size - old.first, joined)
        else:
            clusters.append(Cluster(first, size, ((slot, 0, code),)))
    return Layout(at - phase, tuple(clusters))
