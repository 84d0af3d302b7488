"""The quarantine ledger: every message and every row that was not used, with its reason."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from maglev_offline.errors import MaglevOfflineError
from maglev_offline.logs.columns import NO_TIME

RULE_VERSION = 3
"""Raised whenever a rule changes what it quarantines, or what a sample says of itself."""

SCHEMA = pa.schema(
    [
        ("log_id", pa.string()),
        ("level", pa.string()),
        ("topic", pa.string()),
        ("point", pa.string()),
        ("t", pa.timestamp("ns", tz="UTC")),
        ("message_index", pa.int64()),
        ("byte_offset", pa.int64()),
        ("code", pa.string()),
        ("detail", pa.string()),
        ("count", pa.int64()),
        ("rule_version", pa.int32()),
    ]
)
"""Level `message` speaks of messages as logged, level `sample` of grid rows; `message_index` is that within the
topic in file order, `byte_offset` where in the file the damage lies that took the messages; -1 where there is none."""

Level = Literal["message", "sample"]


@dataclass(frozen=True)
class Quarantined:
    """Messages or rows that were put aside for one reason, n of them; arrays have shape [n].

    `t_ns` is `NO_TIME` where there is no time; `count` is how many messages each entry stands for.
    """

    level: Level
    code: str
    t_ns: NDArray[np.int64]
    message_index: NDArray[np.int64]
    topic: str = ""
    point: str = ""
    detail: str | NDArray[np.str_] = ""
    count: int = 1
    byte_offset: int = -1

    @property
    def total(self) -> int:
        """How many messages or rows these entries stand for."""
        return len(self.t_ns) * self.count


def rows(
    point: str, topic: str, code: str, t_ns: NDArray[np.int64], detail: str | NDArray[np.str_] = ""
) -> Quarantined:
    """Entries for grid rows of a point; `topic` is the one that its gap comes from."""
    return Quarantined("sample", code, t_ns, np.full(len(t_ns), -1), topic, point, detail)


def together(topic: str, code: str, count: int, detail: str = "", *, byte_offset: int = -1) -> Quarantined:
    """One entry that stands for many messages of a topic."""
    return Quarantined("message", code, np.array([NO_TIME]), np.array([-1]), topic, "", detail, count, byte_offset)


def table(log_id: str, entries: Sequence[Quarantined]) -> pa.Table:
    """The ledger of one log: messages by topic and place in the file, then rows by point and time."""
    parts = [_part(log_id, entry) for entry in entries if len(entry.t_ns)]
    made = pa.concat_tables(parts) if parts else SCHEMA.empty_table()
    return made.sort_by([(name, "ascending") for name in _ORDER])


_ORDER = ("level", "topic", "point", "message_index", "t", "byte_offset", "code")


def _part(log_id: str, entry: Quarantined) -> pa.Table:
    n = len(entry.t_ns)
    detail = pa.repeat(entry.detail, n) if isinstance(entry.detail, str) else pa.array(entry.detail, type=pa.string())
    columns = {
        "log_id": pa.repeat(log_id, n),
        "level": pa.repeat(entry.level, n),
        "topic": pa.repeat(entry.topic, n),
        "point": pa.repeat(entry.point, n),
        "t": pa.array(entry.t_ns, mask=entry.t_ns == NO_TIME, type=pa.int64()).cast(SCHEMA.field("t").type),
        "message_index": pa.array(entry.message_index, type=pa.int64()),
        "byte_offset": pa.array(np.full(n, entry.byte_offset), type=pa.int64()),
        "code": pa.repeat(entry.code, n),
        "detail": detail,
        "count": pa.array(np.full(n, entry.count), type=pa.int64()),
        "rule_version": pa.array(np.full(n, RULE_VERSION), type=pa.int32()),
    }
    return pa.Table.from_arrays([columns[name] for name in SCHEMA.names], schema=SCHEMA)


def counts(entries: Sequence[Quarantined], level: Level | None = None) -> dict[str, int]:
    """How many messages or rows each code stands for; of one level, or of both (their codes are different)."""
    found: dict[str, int] = {}
    for entry in entries:
        if entry.total and level in (None, entry.level):
            found[entry.code] = found.get(entry.code, 0) + entry.total
    return dict(sorted(found.items()))


def check_sums(
    where: str,
    put_aside: Mapping[Level, Mapping[str, int]],
    *,
    messages: Mapping[str, int],
    rows: Mapping[str, int],
) -> None:
    """Hold the ledger against what came in and what was used: `in` = `used` + quarantined, at both levels.

    `put_aside` has for each level how many each code stands for.

    Raises
    ------
    MaglevOfflineError: a message or a row was lost or counted twice, which is a fault of this package.
    """
    levels: tuple[tuple[Level, Mapping[str, int]], ...] = (("message", messages), ("sample", rows))
    for level, sums in levels:
        quarantined = sum(put_aside[level].values())
        if sums["in"] != sums["used"] + quarantined:
            raise MaglevOfflineError(
                f"the ledger does not add up: {sums['in']:,} {level}s came in, {sums['used']:,} were used and "
                f"{quarantined:,} quarantined.",
                where=where,
                todo="This is a fault of maglev-offline: please report it with the log.",
            )
