"""The shape of JSON messages along the wanted paths, as Arrow's schema for them, and the way back to columns."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from maglev_offline.logs.decode import json_stamps
from maglev_offline.logs.decode.json_block import Flags
from maglev_offline.logs.decode.json_template import is_index
from maglev_offline.logs.decode.payloads import NO_TIME, Path
from maglev_offline.logs.schema_fields import TIME_PARTS

_KINDS: dict[type, str] = {dict: "object", list: "list", str: "string"}


class NoShapeError(ValueError):
    """Paths that no schema of Arrow covers."""


@dataclass
class Node:
    """What stands at one place of the messages; `kind` is `object`, `list`, `number`, `integer` or `string`."""

    kind: str
    below: dict[str, "Node"] = field(default_factory=dict)

    def type(self) -> pa.DataType:
        """Return what Arrow calls it."""
        match self.kind:
            case "object":
                return pa.struct([pa.field(name, child.type()) for name, child in self.below.items()])
            case "list":
                return pa.list_(self.below[""].type())
        return {"number": pa.float64(), "integer": pa.int64(), "string": pa.string()}[self.kind]


@dataclass(frozen=True)
class Shape:
    """The schema that messages are read with; an integer `clock` is read as such."""

    root: Node
    schema: pa.Schema

    @classmethod
    def of(cls, samples: Sequence[Any], paths: Sequence[Path], whole_clock: Path | None) -> "Shape":
        """Find the shape from some decoded messages.

        Raises
        ------
        NoShapeError: a path leads through a scalar, or to something different in every message.
        """
        root = Node("object")
        for path in paths:
            _add(root, samples, path, "integer" if path == whole_clock else "number")
        _arrange(root, [sample for sample in samples if isinstance(sample, dict)])
        try:
            return cls(root, pa.schema([pa.field(name, child.type()) for name, child in root.below.items()]))
        except UnicodeEncodeError as error:
            raise NoShapeError(str(error)) from None


def _add(root: Node, samples: Sequence[Any], path: Path, leaf: str) -> None:
    here, values = root, list(samples)
    for depth, step in enumerate(path):
        if here.kind == "list" and not is_index(step):
            raise NoShapeError("no index into a list")
        values = [_below(value, step) for value in values]
        kind = _kind(values, path[depth + 1 :], leaf)
        name = "" if here.kind == "list" else step
        child = here.below.setdefault(name, Node(kind))
        if {child.kind, kind} == {"number", "integer"}:
            child.kind = "integer"
        elif child.kind != kind:
            raise NoShapeError("two kinds at one place")
        here = child
    if here.kind == "object":
        for name in _part_names(values):
            part = here.below.setdefault(name, Node("integer"))
            if part.kind == "number":
                part.kind = "integer"
    elif here.kind == "list":
        raise NoShapeError("a list where a number is wanted")


def _part_names(values: Sequence[Any]) -> tuple[str, ...]:
    """Names of time parts as far as one of them may win over those that the samples have."""
    names: list[str] = []
    for pair in TIME_PARTS:
        names += pair
        if any(isinstance(value, dict) and set(pair) <= set(value) for value in values):
            break
    return tuple(dict.fromkeys(names))


def _arrange(node: Node, values: Sequence[Any]) -> None:
    """Put the members in the order in which the first sample has them: so Arrow finds them faster."""
    first = next((list(value) for value in values if isinstance(value, dict)), [])
    order = {name: place for place, name in enumerate(first)}
    node.below = dict(sorted(node.below.items(), key=lambda item: order.get(item[0], len(order))))
    for name, child in node.below.items():
        _arrange(child, [_below(value, name or "0") for value in values])


def _below(value: Any, step: str) -> Any:
    if isinstance(value, dict):
        return value.get(step)
    if isinstance(value, list) and is_index(step) and int(step) < len(value):
        return value[int(step)]
    return None


def _kind(values: Sequence[Any], rest: Path, leaf: str) -> str:
    """What most likely stands at a place where the samples have these values, with this rest of a path to go."""
    kinds = Counter(_KINDS.get(type(value), leaf) for value in values if value is not None)
    if rest:
        kinds = Counter({kind: count for kind, count in kinds.items() if kind in ("object", "list")})
        kinds["list" if is_index(rest[0]) else "object"] += 0
    return max(kinds, key=lambda kind: kinds[kind], default=leaf)


class Read:
    """Columns from a table of n messages of one shape; `sure` [n] loses the rows that are doubtful."""

    def __init__(self, shape: Shape, table: pa.Table) -> None:
        self._shape = shape
        self._table = table
        self.sure: Flags = np.ones(len(table), dtype=np.bool_)

    def numbers(self, path: Path) -> NDArray[np.float64]:
        """Numbers [n]; NaN where there is none."""
        node, column = self._at(path)
        match node.kind:
            case "object":
                stamps = self._time(node, column)
                return np.where(stamps == NO_TIME, np.nan, stamps.astype(np.float64) / 1e9)
            case "string":
                return np.full(len(column), np.nan)
        numbers = _filled(column).astype(np.float64)
        if column.null_count:
            numbers[_is_null(column)] = np.nan
        # Infinite is what is too large for float64, but an integer of that kind is no number.
        self.sure &= ~np.isinf(numbers)
        return numbers

    def stamps(self, path: Path, ns_per_unit: float) -> NDArray[np.int64]:
        """Time stamps [n] in nanoseconds; `NO_TIME` where there is none."""
        node, column = self._at(path)
        if node.kind == "object":
            return self._time(node, column)
        if node.kind == "string":
            return np.full(len(column), NO_TIME, dtype=np.int64)
        of = json_stamps.of_ints if node.kind == "integer" else json_stamps.of_floats
        stamps, sure = of(_filled(column), ns_per_unit)
        missing = _is_null(column)
        self.sure &= sure | missing
        return np.where(missing, NO_TIME, stamps)

    def _time(self, node: Node, column: pa.Array) -> NDArray[np.int64]:
        found = np.full(len(column), NO_TIME, dtype=np.int64)
        open_rows = ~_is_null(column)
        for names in TIME_PARTS:
            if all(name in node.below and node.below[name].kind == "integer" for name in names):
                seconds, nanoseconds = (self._member(node, column, name) for name in names)
                there = open_rows & ~_is_null(seconds) & ~_is_null(nanoseconds)
                stamps, sure = json_stamps.of_parts(_filled(seconds), _filled(nanoseconds))
                self.sure &= sure | ~there
                found[there] = stamps[there]
                open_rows &= ~there
        # Here the object may have parts that the samples did not.
        self.sure &= ~open_rows
        return found

    def _member(self, node: Node, column: pa.Array, name: str) -> pa.Array:
        return pc.struct_field(column, list(node.below).index(name))

    def _at(self, path: Path) -> tuple[Node, pa.Array]:
        node = self._shape.root.below[path[0]]
        column = _one_chunk(self._table.column(path[0]))
        for step in path[1:]:
            if node.kind == "list":
                node, column = node.below[""], _element(column, int(step))
            else:
                node, column = node.below[step], self._member(node, column, step)
        return node, column


def _element(lists: pa.ListArray, index: int) -> pa.Array:
    """One element of every list [n]; null where a list has fewer."""
    bounds = lists.offsets.to_numpy()
    places = bounds[:-1] + index
    short = (places >= bounds[1:]) | _is_null(lists)
    return lists.values.take(pa.array(places, mask=short))


def _one_chunk(column: pa.ChunkedArray) -> pa.Array:
    found = column.combine_chunks()
    return found if isinstance(found, pa.Array) else pa.concat_arrays(found.chunks)


def _filled(column: pa.Array) -> NDArray[Any]:
    """The numbers [n], 0 in place of null."""
    found: NDArray[Any] = (pc.fill_null(column, 0) if column.null_count else column).to_numpy()
    return found


def _is_null(column: pa.Array) -> Flags:
    if column.null_count == 0:
        return np.zeros(len(column), dtype=np.bool_)
    found: Flags = column.is_null().to_numpy(zero_copy_only=False)
    return found
