"""The `[select]` table of a recipe: which part of the logs is used; what is left out is counted, with its reason."""

import re
from collections.abc import Mapping
from datetime import UTC, date, datetime
from decimal import Decimal
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import field_validator, model_validator

from maglev_offline.errors import InputError
from maglev_offline.ingest import conditions
from maglev_offline.settings import Settings

NOT_SELECTED_TIME = "not_selected_time"
NOT_SELECTED_TOPIC = "not_selected_topic"
NOT_SELECTED_POINT = "not_selected_point"
NOT_SELECTED_CONDITION = "not_selected_condition"
CODES = (NOT_SELECTED_TIME, NOT_SELECTED_TOPIC, NOT_SELECTED_POINT, NOT_SELECTED_CONDITION)
"""Reason codes of the ledger for what `[select]` leaves out; a code, once used, never changes its meaning."""

_OFFSET = re.compile(r"\+\s*(\d{1,12}(?:\.\d{1,12})?)\s*(s|ms|min|h)")
_NS_OF = {"ms": 10**6, "s": 10**9, "min": 60 * 10**9, "h": 3600 * 10**9}
_FRACTION = re.compile(r"(:\d\d)[.,](\d{1,9})(?!\d)")
_EARLIEST, _LATEST = int(np.iinfo(np.int64).min), int(np.iinfo(np.int64).max)


class _Time(NamedTuple):
    """Nanoseconds, from 1970 (UTC) or from the log's beginning."""

    ns: int
    from_beginning: bool


class Selection(Settings):
    """Which messages and which samples are used; what is empty selects everything.

    `start`, `end`: log times, start included and end not, so that selections that adjoin share nothing. Either a date
    and time with its zone ("2025-03-01T12:00:00Z") or a time from the log's beginning ("+12.5s"; s, ms, min, h).
    `topics`, `exclude_topics`, `points`: names or patterns, in which `*` stands for anything (`/` too), `?` for one
    character and `[ab]` for one of some; a topic is used if it matches one of `topics` and none of `exclude_topics`.
    `where`: conditions on the columns of the samples in SI units, such as "speed_m_s > 5" or
    "gap_m between 0.004 and 0.012" (see `conditions`); a sample must fulfil all of them, and one in which a value is
    not known fulfils none.
    """

    start: str | None = None
    end: str | None = None
    topics: tuple[str, ...] = ()
    exclude_topics: tuple[str, ...] = ()
    points: tuple[str, ...] = ()
    where: tuple[str, ...] = ()

    @field_validator("start", "end", mode="before")
    @classmethod
    def _plain_time(cls, value: Any) -> Any:
        # TOML has times of its own; a date alone is refused, since it says nothing of a zone.
        return value.isoformat() if isinstance(value, date) else value

    @field_validator("start", "end")
    @classmethod
    def _readable_time(cls, value: str | None) -> str | None:
        if value is not None:
            _time(value)
        return value

    @field_validator("where")
    @classmethod
    def _readable_conditions(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for text in value:
            conditions.parse(text)
        return value

    @model_validator(mode="after")
    def _forwards(self) -> "Selection":
        if self.start is not None and self.end is not None:
            start, end = _time(self.start), _time(self.end)
            if start.from_beginning == end.from_beginning and end.ns <= start.ns:
                raise ValueError(f"end ({self.end}) must be after start ({self.start})")
        return self

    @property
    def selects_all(self) -> bool:
        """Whether nothing is left out."""
        return self == Selection()


class Chosen(NamedTuple):
    """What is kept, shape [n]; the ledger's code for all else; and for each that is not kept, a detail or ''.

    `detail` has the shape of `~keep`'s true entries, as `ledger.Quarantined` wants it, or is one text for all.
    """

    keep: NDArray[np.bool_]
    code: str
    detail: str | NDArray[np.str_] = ""


def wants_topic(selection: Selection, topic: str) -> bool:
    """Whether messages of this topic are used."""
    return (not selection.topics or _matches(topic, selection.topics)) and not _matches(topic, selection.exclude_topics)


def wants_point(selection: Selection, point: str) -> bool:
    """Whether samples of this suspension point are used."""
    return not selection.points or _matches(point, selection.points)


def _matches(name: str, patterns: tuple[str, ...]) -> bool:
    return any(name == pattern or fnmatchcase(name, pattern) for pattern in patterns)


def span_ns(selection: Selection, first_ns: int) -> tuple[int, int]:
    """Log times [start, end) of the selection for a log whose first message has log time `first_ns`.

    Raises
    ------
    InputError: in this log the end does not come after the start.
    """
    start, end = _EARLIEST, _LATEST
    if selection.start is not None:
        start = _absolute(_time(selection.start), first_ns)
    if selection.end is not None:
        end = _absolute(_time(selection.end), first_ns)
    if end <= start:
        raise InputError(
            f"in this log the end ({selection.end}) does not come after the start ({selection.start}).",
            where="[select] end",
            todo="Give both as dates and times, or both from the log's beginning.",
        )
    return start, end


def messages_mask(topic: str, t_ns: NDArray[np.int64], selection: Selection, first_ns: int) -> Chosen:
    """Which messages of a topic with log times `t_ns` [n] are used; `first_ns` is the log's first log time.

    Raises InputError as `span_ns` does.
    """
    if not wants_topic(selection, topic):
        return Chosen(np.zeros(len(t_ns), dtype=np.bool_), NOT_SELECTED_TOPIC)
    start, end = span_ns(selection, first_ns)
    keep = t_ns >= start
    if selection.end is not None:
        keep &= t_ns < end
    early = np.asarray(t_ns)[~keep] < start
    return Chosen(keep, NOT_SELECTED_TIME, np.where(early, f"before {selection.start}", f"not before {selection.end}"))


def rows_mask(columns: Mapping[str, ArrayLike], selection: Selection) -> Chosen:
    """Which rows of columns of equal length [n] fulfil all conditions; the detail is the first that a row fails.

    Raises
    ------
    InputError: a condition speaks of a column that is not there; the message lists those that are.
    """
    rows = max((np.shape(column)[0] for column in columns.values()), default=0)
    first_failed = np.full(rows, -1)
    for number, text in enumerate(selection.where):
        holds = conditions.parse(text).holds(columns, rows)
        first_failed[~holds & (first_failed < 0)] = number
    keep = first_failed < 0
    texts = np.array(selection.where or ("",), dtype=np.str_)
    return Chosen(keep, NOT_SELECTED_CONDITION, texts[first_failed[~keep]])


def columns_needed(selection: Selection) -> tuple[str, ...]:
    """Columns that the conditions speak of, each once."""
    return tuple(dict.fromkeys(name for text in selection.where for name in conditions.parse(text).columns))


def cut_segments(
    segment: NDArray[np.int32], step: NDArray[np.int32], keep: NDArray[np.bool_]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Segment and step of the rows of one point that are kept, numbered anew from 0, shape [keep.sum()] each.

    `segment` and `step` [n] are in order. A segment ends wherever a row was cut out, so that no two rows that did not
    follow each other are joined; a segment of which nothing is left has no number.
    """
    kept_segment, kept_step = segment[keep], step[keep]
    if len(kept_segment) == 0:
        return np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32)
    new = np.concatenate([[True], (np.diff(kept_segment) != 0) | (np.diff(kept_step) != 1)])
    number = np.cumsum(new) - 1
    at = np.arange(len(number))
    return number.astype(np.int32), (at - at[new][number]).astype(np.int32)


def _absolute(time: _Time, first_ns: int) -> int:
    return min(max(time.ns + (first_ns if time.from_beginning else 0), _EARLIEST), _LATEST)


def _time(text: str) -> _Time:
    """Read a time; every digit down to the nanosecond counts, which datetime alone would lose."""
    offset = _OFFSET.fullmatch(text.strip())
    if offset:
        return _Time(int(Decimal(offset[1]) * _NS_OF[offset[2]]), True)
    fraction = _FRACTION.search(text)
    try:
        read = datetime.fromisoformat(_FRACTION.sub(r"\1", text.strip(), count=1))
    except ValueError:
        raise ValueError(
            f"{text!r} is no time; write it like 2025-03-01T12:00:00Z, or from the log's beginning like +12.5s"
        ) from None
    if read.tzinfo is None:
        raise ValueError(f"{text!r} has no zone; write it like 2025-03-01T12:00:00Z or 2025-03-01T20:00:00+08:00")
    since = read - datetime(1970, 1, 1, tzinfo=UTC)
    below_s = int(fraction[2].ljust(9, "0")) if fraction else since.microseconds * 1000
    return _Time((since.days * 86_400 + since.seconds) * 10**9 + below_s, False)
