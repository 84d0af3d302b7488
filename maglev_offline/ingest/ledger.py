"""The quarantine ledger: every message and every row that was not used, with its reason."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from maglev_offline.errors import MaglevOfflineError
from maglev_offline.logs.reader import NO_TIME

RULE_VERSION = 1
"""Raised whenever a rule changes what it quarantines."""

SCHEMA = pa.schema(
    [
        ("log_id", pa.string()),
        ("level", pa.string()),
        ("topic", pa.string()),
        ("point", pa.string()),
        ("t", pa.timestamp("ns", tz="UTC")),
        ("message_index", pa.int64()),
        ("code", pa.string()),
        ("detail", pa.string()),
        ("count", pa.int64()),
        ("rule_version", pa.int32()),
    ]
)
"""Level `message` speaks of messages as logged, level `sample` of grid rows; `message_index` is that within the
topic in file order, -1 where there is none."""

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

    @property
    def total(self) -> int:
        """How many messages or rows these entries stand for."""
        return len(self.t_ns) * self.count


def rows(point: str, topic: str, code: str, t_ns: NDArray[np.int64], detail: str = "") -> Quarantined:
    """Entries for grid rows of a point; `topic` is the one that its gap comes from."""
    return Quarantined("sample", code, t_ns, np.full(len(t_ns), -1), topic, point, detail)


def whole_topic(topic: str, code: str, count: int, detail: str = "") -> Quarantined:
    """One entry that stands for all messages of a topic."""
    return Quarantined("message", code, np.array([NO_TIME]), np.array([-1]), topic, "", detail, count)


def table(log_id: str, entries: Sequence[Quarantined]) -> pa.Table:
    """The ledger of one log: messages by topic and place in the file, then rows by point and time."""
    used = sorted(
        (e for e in entries if len(e.t_ns)), key=lambda e: (e.level, e.topic if e.level == "message" else e.point)
    )
    columns: dict[str, list[NDArray[np.generic]]] = {name: [] for name in SCHEMA.names}
    for e in used:
        n = len(e.t_ns)
        for name, value in (("log_id", log_id), ("level", e.level), ("topic", e.topic), ("point", e.point)):
            columns[name].append(np.full(n, value, dtype=object))
        columns["t"].append(e.t_ns)
        columns["message_index"].append(e.message_index)
        columns["code"].append(np.full(n, e.code, dtype=object))
        columns["detail"].append(np.broadcast_to(np.asarray(e.detail, dtype=object), (n,)))
        columns["count"].append(np.full(n, e.count))
        columns["rule_version"].append(np.full(n, RULE_VERSION))
    arrays = []
    for name, kind in zip(SCHEMA.names, SCHEMA.types, strict=True):
        parts = columns[name]
        if name == "t":
            t = np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)
            arrays.append(pa.array(t, mask=t == NO_TIME, type=pa.int64()).cast(kind))
        else:
            arrays.append(pa.array(np.concatenate(parts) if parts else [], type=kind))
    made = pa.Table.from_arrays(arrays, schema=SCHEMA)
    return made.sort_by([("level", "ascending"), ("topic", "ascending"), ("point", "ascending"),
                         ("message_index", "ascending"), ("t", "ascending"), ("code", "ascending")])  # fmt: skip


def counts(entries: Sequence[Quarantined], level: Level | None = None) -> dict[str, int]:
    """How many messages or rows each code stands for; of one level, or of both (their codes are different)."""
    found: dict[str, int] = {}
    for entry in entries:
        if entry.total and level in (None, entry.level):
            found[entry.code] = found.get(entry.code, 0) + entry.total
    return dict(sorted(found.items()))


def check_sums(
    where: str, entries: Sequence[Quarantined], *, messages: Mapping[str, int], rows: Mapping[str, int]
) -> None:
    """Hold the ledger against what came in and what was used: `in` = `used` + quarantined, at both levels.

    Raises
    ------
    MaglevOfflineError: a message or a row was lost or counted twice, which is a fault of this package.
    """
    levels: tuple[tuple[Level, Mapping[str, int]], ...] = (("message", messages), ("sample", rows))
    for level, sums in levels:
        put_aside = sum(counts(entries, level).values())
        if sums["in"] != sums["used"] + put_aside:
            raise MaglevOfflineError(
                f"the ledger does not add up: {sums['in']:,} {level}s came in, {sums['used']:,} were used and "
                f"{put_aside:,} quarantined.",
                where=where,
                todo="This is a fault of maglev-offline: please report it with the log.",
            )
