"""One JSON message as a template of others: what is constant in the text, and where its scalars stand."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from maglev_offline.logs.decode.payloads import Path, Wanted
from maglev_offline.logs.schema_fields import TIME_PARTS

DELIMITERS = b",}]\r\n"
"""One of these ends every scalar of a template; none stands within a number."""

CONSTANT = -1
"""Stands in for a string that belongs to the constant text: it holds an escape or one of the delimiters."""

LONGEST_TEMPLATE = 1 << 20
"""Bytes of the longest message that is held against a template."""

_DEEPEST, _MOST_TOKENS = 64, 2048
_LEXEME = re.compile(rb'[ \t\n\r]*(?:("(?:[^"\\]|\\.)*")|([-+.\w]+)|([]\[{}:,]))', re.DOTALL)


@dataclass(frozen=True)
class Token:
    """A scalar in the text of the first message: bytes `start` to `end`."""

    start: int
    end: int
    is_string: bool


class Missing:
    """A path that leads to nothing, or to what is no number, in every message of the template."""


MISSING = Missing()

Source = int | tuple[int, int] | Missing
"""Where a path leads: one scalar, the two parts of a time, or nothing; scalars by index among those no strings."""


class NoTemplateError(ValueError):
    """A message of which no template can be made."""


@dataclass(frozen=True)
class Template:
    """The `pieces` of constant text around the `tokens` (one more than these), and where the wanted paths lead."""

    tokens: tuple[Token, ...]
    pieces: tuple[bytes, ...]
    sources: tuple[Source, ...]
    clock: Source

    @classmethod
    def of(cls, text: bytes, wanted: Wanted) -> "Template":
        """Take a message apart; NoTemplateError where that cannot be done with certainty."""
        try:
            json.loads(text.decode("utf-8"), object_pairs_hook=_unique)
        except (ValueError, RecursionError) as error:
            raise NoTemplateError(str(error)) from None
        scan = _Scan(text)
        root = scan.run()
        tokens = tuple(scan.tokens)
        if not tokens or not isinstance(root, dict):
            raise NoTemplateError("no scalar")
        cuts = [0, *(place for token in tokens for place in (token.start, token.end)), len(text)]
        pieces = tuple(text[a:b] for a, b in zip(cuts[::2], cuts[1::2], strict=True))
        if not all(piece[:1] and piece[0] in DELIMITERS for piece in pieces[1:]):
            raise NoTemplateError("blank after a scalar")
        numbers = {token: index for index, token in enumerate(k for k, t in enumerate(tokens) if not t.is_string)}
        return cls(
            tokens,
            pieces,
            tuple(_source(root, path, numbers) for path in wanted.paths),
            _source(root, tuple(wanted.clock.path.split(".")), numbers) if wanted.clock else MISSING,
        )


@dataclass
class _Scan:
    """Finds the scalars of a valid JSON text; its tree has the index of a token in place of each of them."""

    text: bytes
    tokens: list[Token] = field(default_factory=list)
    place: int = 0

    def run(self) -> Any:
        root: list[Any] = []
        open_containers: list[dict[str, Any] | list[Any]] = [root]
        key: str | None = None
        while (found := _LEXEME.match(self.text, self.place)) is not None:
            self.place = found.end()
            string, scalar, mark = found.groups()
            inner = open_containers[-1]
            if string is not None and isinstance(inner, dict) and key is None:
                key = json.loads(string)
            elif mark in (b"{", b"["):
                container: dict[str, Any] | list[Any] = {} if mark == b"{" else []
                _put(inner, key, container)
                open_containers.append(container)
                key = None
                if len(open_containers) > _DEEPEST:
                    raise NoTemplateError("deep")
            elif mark in (b"}", b"]"):
                open_containers.pop()
            elif mark is None:
                _put(inner, key, self._token(found.start(1) if scalar is None else found.start(2), string is not None))
                key = None
        return root[0]

    def _token(self, start: int, is_string: bool) -> int:
        if is_string and any(byte in DELIMITERS + b"\\" for byte in self.text[start : self.place]):
            return CONSTANT
        if len(self.tokens) == _MOST_TOKENS:
            raise NoTemplateError("many")
        self.tokens.append(Token(start, self.place, is_string))
        return len(self.tokens) - 1


def _put(inner: dict[str, Any] | list[Any], key: str | None, value: Any) -> None:
    if isinstance(inner, list):
        inner.append(value)
    elif key is not None:
        inner[key] = value


def _unique(pairs: list[tuple[str, Any]]) -> Mapping[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise NoTemplateError("a key twice")
    return found


def _source(root: Any, path: Path, numbers: Mapping[int, int]) -> Source:
    here = root
    for step in path:
        if isinstance(here, dict):
            here = here.get(step)
            if here is None:
                return MISSING
        elif isinstance(here, list) and is_index(step):
            if int(step) >= len(here):
                return MISSING
            here = here[int(step)]
        else:
            raise NoTemplateError("a path through a scalar")
    if isinstance(here, int):
        return numbers.get(here, MISSING)
    if isinstance(here, dict):
        for names in TIME_PARTS:
            seconds, nanoseconds = (here.get(name) for name in names)
            if isinstance(seconds, int) and isinstance(nanoseconds, int) and {seconds, nanoseconds} <= set(numbers):
                return numbers[seconds], numbers[nanoseconds]
    return MISSING


def is_index(step: str) -> bool:
    """Whether the step of a path is an index into a list, for certain."""
    return step.isascii() and step.isdigit() and len(step) < 10
