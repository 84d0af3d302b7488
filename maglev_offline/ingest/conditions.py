"""Conditions on columns, such as `speed_m_s > 5 and not 0.004 <= gap_m < 0.012`: a language of numbers and names only.

Comparisons (chained ones too), `x between a and b` (both ends included), `and`, `or`, `not`, parentheses, `+ - * /`.
Nothing in it can call, index or reach anything: a condition may come from a stranger's recipe.
"""

import ast
import operator
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maglev_offline.errors import InputError

LONGEST = 2000
"""Characters of a condition; a longer one is no condition that a person wrote."""

DEEPEST = 60
"""Levels of nesting, so that no condition exhausts the stack."""

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_BETWEEN = re.compile(rf"\b([A-Za-z_]\w*)\s+between\s+({_NUMBER})\s+and\s+({_NUMBER})(?![\w.])")

_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


class _Truth(NamedTuple):
    """Rows that are known to fulfil, and rows that are known not to; where a value is NaN neither is known."""

    yes: NDArray[np.bool_]
    no: NDArray[np.bool_]


@dataclass(frozen=True)
class Condition:
    """One condition that was checked: its text as given, and the columns that it speaks of, in order of appearance."""

    text: str
    columns: tuple[str, ...]
    tree: ast.expr

    def holds(self, columns: Mapping[str, ArrayLike], rows: int) -> NDArray[np.bool_]:
        """Rows that fulfil the condition, shape [rows]; a row in which a value is not known (NaN) never does.

        A comparison with NaN is neither true nor false, so that `not speed_m_s > 5` says the same as `speed_m_s <= 5`.

        Raises
        ------
        InputError: a column is not there.
        """
        missing = [name for name in self.columns if name not in columns]
        if missing:
            raise InputError(
                f"there is no column {', '.join(missing)}; there are {', '.join(sorted(columns)) or 'none'}.",
                where=f"condition {self.text!r}",
                todo="Map it under [signals.context], or correct the condition.",
            )
        known = {name: np.asarray(columns[name], dtype=np.float64) for name in self.columns}
        with np.errstate(all="ignore"):
            return np.array(np.broadcast_to(_truth(self.tree, known).yes, (rows,)))


def parse(text: str) -> Condition:
    """Read a condition.

    Raises
    ------
    ValueError: it is none; the message says why, in a form that fits behind the name of the table and the key.
    """
    if len(text) > LONGEST:
        raise ValueError(f"a condition has at most {LONGEST} characters, this one has {len(text)}")
    readable = _BETWEEN.sub(r"(\2 <= \1 <= \3)", text.strip())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of `1and 2`, which is refused or understood like any other
            tree = ast.parse(readable, mode="eval").body
    except SyntaxError as error:
        raise ValueError(f"{text!r} is no condition ({error.msg}); write it like `speed_m_s > 5`") from None
    except (ValueError, RecursionError, MemoryError):  # a null byte; nested too deeply for the parser
        raise ValueError(f"{text[:60]!r} is no condition; write it like `speed_m_s > 5`") from None
    _check_truth(tree, text, 0)
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    names.sort(key=lambda node: (node.lineno, node.col_offset))
    return Condition(text, tuple(dict.fromkeys(node.id for node in names)), tree)


def _check_truth(node: ast.expr, text: str, depth: int) -> None:
    """Refuse whatever does not end in yes or no."""
    _check_depth(text, depth)
    match node:
        case ast.BoolOp(values=parts):
            for part in parts:
                _check_truth(part, text, depth + 1)
        case ast.UnaryOp(op=ast.Not(), operand=part):
            _check_truth(part, text, depth + 1)
        case ast.Compare(left=left, ops=ops, comparators=others) if all(type(op) in _COMPARE for op in ops):
            for part in (left, *others):
                _check_number(part, text, depth + 1)
        case ast.Name() | ast.BinOp() | ast.UnaryOp() | ast.Constant():
            raise ValueError(f"in {text!r}, {_shown(node)} is no comparison; write it like `speed_m_s > 5`")
        case _:
            _refuse(node, text)


def _check_number(node: ast.expr, text: str, depth: int) -> None:
    """Refuse whatever is no number, no column and no sum of them."""
    _check_depth(text, depth)
    match node:
        case ast.Name():
            return
        case ast.Constant(value=bool()):
            _refuse(node, text)
        case ast.Constant(value=int() | float() as value):
            # A float holds up to 1.8e308; int() of more would fail later, and inf compares with nothing.
            if not abs(value) < 1e300:
                raise ValueError(f"in {text[:60]!r} a number is too large")
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=part):
            _check_number(part, text, depth + 1)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
            _check_number(left, text, depth + 1)
            _check_number(right, text, depth + 1)
        case _:
            _refuse(node, text)


def _check_depth(text: str, depth: int) -> None:
    if depth > DEEPEST:
        raise ValueError(f"{text[:60]!r} is nested more than {DEEPEST} levels deep")


def _refuse(node: ast.expr, text: str) -> None:
    raise ValueError(
        f"in {text!r}, {_shown(node)} is not allowed; only column names, numbers, < <= > >= == !=, `between`, "
        "and, or, not, + - * / and parentheses are"
    )


def _shown(node: ast.expr) -> str:
    try:
        return f"`{ast.unparse(node)[:60]}`"
    except (RecursionError, ValueError):
        return "a part of it"


def _truth(node: ast.expr, columns: Mapping[str, NDArray[np.float64]]) -> _Truth:
    match node:
        case ast.BoolOp(op=joined, values=parts):
            found = [_truth(part, columns) for part in parts]
            yes, no = [part.yes for part in found], [part.no for part in found]
            if isinstance(joined, ast.And):
                return _Truth(reduce(np.logical_and, yes), reduce(np.logical_or, no))
            return _Truth(reduce(np.logical_or, yes), reduce(np.logical_and, no))
        case ast.UnaryOp(operand=part):
            inner = _truth(part, columns)
            return _Truth(inner.no, inner.yes)
        case ast.Compare(left=left, ops=ops, comparators=others):
            values = [_number(part, columns) for part in (left, *others)]
            links = [
                _link(_COMPARE[type(compared)](a, b), np.isfinite(a) & np.isfinite(b))
                for a, compared, b in zip(values, ops, values[1:], strict=False)
            ]
            return _Truth(
                reduce(np.logical_and, [link.yes for link in links]), reduce(np.logical_or, [link.no for link in links])
            )
    raise TypeError(f"unchecked condition: {ast.dump(node)}")


def _link(holds: NDArray[np.bool_], known: NDArray[np.bool_]) -> _Truth:
    return _Truth(holds & known, ~holds & known)


def _number(node: ast.expr, columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    match node:
        case ast.Name(id=name):
            return columns[name]
        case ast.Constant(value=int() | float() as value):
            return np.asarray(float(value))
        case ast.UnaryOp(op=op, operand=part):
            inner = _number(part, columns)
            return np.negative(inner) if isinstance(op, ast.USub) else inner
        case ast.BinOp(left=left, op=op, right=right):
            return np.asarray(_ARITHMETIC[type(op)](_number(left, columns), _number(right, columns)))
    raise TypeError(f"unchecked condition: {ast.dump(node)}")
