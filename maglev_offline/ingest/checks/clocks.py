"""The clocks of a log held against each other: delays, late messages, drift and jumps."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.checks.codes import make
from maglev_offline.ingest.checks.settings import CheckSettings
from maglev_offline.ingest.checks.timing import FARTHEST_NS, Timing, countable
from maglev_offline.ingest.clock import NS_PER_MS
from maglev_offline.ingest.findings import Finding
from maglev_offline.ingest.median import median
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.columns import ChannelColumns

Index = NDArray[np.int64]
Name = tuple[str, str, str]

_BLOCKS = 32
_JUMPS = 16
"""More than so many jumps of one clock are no jumps, but two clocks that have nothing to do with each other."""


_MOST_AFTER = 4096
"""A late message is looked for among at most about so many after a reset, however long `reorder_ms` is."""


class Delays(NamedTuple):
    """What the clocks say, and which messages (in file order) are late."""

    findings: list[Finding]
    late: Index


def compare(
    name: Name, columns: ChannelColumns, timing: Timing, ingest: IngestSettings, settings: CheckSettings
) -> Delays:
    """Log time against publish time, and the header's stamp against publish time (or log time without one)."""
    found: list[Finding] = []
    late = np.empty(0, dtype=np.int64)
    reorder_ns = round(ingest.reorder_ms * NS_PER_MS)
    if len(timing) < 4 or timing.period_ns == 0:
        return Delays(found, late)
    whole = len(timing) == len(columns)
    log, publish = (times if whole else times[timing.row] for times in (columns.log_time_ns, columns.publish_time_ns))
    published = bool(publish.all()) and countable(publish) and countable(log)
    if published:
        delay = log - publish
        if delay.any():
            delay, jumps = _without_jumps(delay, timing, reorder_ns, settings)
            found += _jump(name, "log time and publish time", jumps, timing)
            more, late = _delays(name, delay, timing, settings)
            found += more + _drift(name, "log time and publish time", delay, timing, settings)
    if columns.clock_ns is not None:
        stamp = columns.clock_ns if whole else columns.clock_ns[timing.row]
        other, words = (publish, "publish time") if published else (log, "log time")
        if countable(stamp) and countable(other):
            difference, jumps = _without_jumps(other - stamp, timing, reorder_ns, settings)
            clocks = f"{words} and header stamp"
            found += _jump(name, clocks, jumps, timing) + _drift(name, clocks, difference, timing, settings)
    return Delays(found, late)


class _Jump(NamedTuple):
    at: int
    size_ns: float


def _without_jumps(
    difference: Index, timing: Timing, reorder_ns: int, settings: CheckSettings
) -> tuple[Index, list[_Jump]]:
    """Find lasting steps of a difference of clocks, and take them out; a few messages at a reset of both may differ."""
    least = settings.clock_jump_periods * timing.period_ns
    jumps: list[_Jump] = []
    level = _blocks(difference)
    rises = np.diff(level)
    # What every block rises by is a drift.
    large = np.flatnonzero(np.abs(rises - median(rises)) > least) if len(rises) else np.empty(0, dtype=np.int64)
    if 0 < len(large) <= _JUMPS:
        difference = difference.copy()
        size = len(difference) / len(level)
        for k in large.tolist():
            low, high = int(k * size), min(int((k + 2) * size), len(difference))
            part = difference[low:high].astype(np.float64)
            middle = (np.median(part[: len(part) // 4 + 1]) + np.median(part[-(len(part) // 4) - 1 :])) / 2
            rising = np.median(part[-(len(part) // 4) - 1 :]) > middle
            beyond = (part > middle) == rising
            at = low + _best_split(beyond)
            before, after = difference[max(at - 50, low) : at], difference[at : at + 50]
            step = float(np.median(after) - np.median(before)) if len(before) and len(after) else 0.0
            if least < abs(step) < FARTHEST_NS:
                jumps.append(_Jump(at, step))
                difference[at:] -= round(step)
    return (_with_way_back(difference, timing, reorder_ns) if len(timing.resets) else difference), jumps


def _with_way_back(difference: Index, timing: Timing, reorder_ns: int) -> Index:
    """What was sent before a reset of all clocks and arrives after it has a delay that lacks the way back: add it."""
    usual = median(difference)
    difference = difference.copy()
    for reset in timing.resets.tolist():
        back = _way_back(reset, timing)
        if not 2 * timing.period_ns < back < FARTHEST_NS:
            continue
        # The message may be late by as much as is sorted in, but one that is usual must never be taken for it.
        off = min(max(0.05 * back, 6 * timing.period_ns, reorder_ns), 0.5 * back)
        # What is late by so much lies no farther behind the reset.
        near = slice(max(reset - 5, 0), reset + 12 + min(round(off / timing.period_ns), _MOST_AFTER))
        odd = np.abs(difference[near] - usual + back) < off
        difference[near] += np.where(odd, round(back), 0)
    return difference


def _best_split(beyond: NDArray[np.bool_]) -> int:
    """Where False turns into True with the fewest exceptions on either side."""
    wrong = np.cumsum(np.where(beyond, 1, -1))
    return int(np.argmin(np.concatenate([[0], wrong])))


def _way_back(reset: int, timing: Timing) -> float:
    return float(timing.t_ns[:reset][-20:].max() - timing.t_ns[reset]) + timing.period_ns


def _blocks(difference: Index) -> NDArray[np.float64]:
    """Medians of up to 32 blocks, of at most 15 messages of each: a lone late message does not show in them."""
    blocks = min(_BLOCKS, len(difference) // 8)
    if blocks < 2:
        return np.empty(0)
    edges = np.linspace(0, len(difference), blocks + 1)[:-1]
    inside = np.linspace(0, len(difference) / blocks - 1, 15)
    some = difference[(edges[:, None] + inside).astype(np.int64)]
    return np.sort(some, axis=1)[:, 7].astype(np.float64)


def _jump(name: Name, clocks: str, jumps: list[_Jump], timing: Timing) -> list[Finding]:
    if not jumps:
        return []
    places = [timing.place(max(jump.at - 1, 0), jump.at) for jump in jumps]
    largest = max(abs(jump.size_ns) for jump in jumps) / NS_PER_MS
    return [make("clock_jump", *name, {"clocks": clocks, "largest_jump_ms": largest}, places=places)]


def _delays(name: Name, delay: Index, timing: Timing, settings: CheckSettings) -> tuple[list[Finding], Index]:
    usual = median(delay[:: max(len(delay) // 2048, 1)])
    found: list[Finding] = []
    limit = settings.late_periods * timing.period_ns
    late = np.empty(0, dtype=np.int64)
    if delay.max() > usual + limit:
        late = np.flatnonzero(delay > usual + limit)
        numbers: dict[str, float | int | str] = {
            "largest_delay_ms": float(delay.max()) / NS_PER_MS,
            "usual_delay_ms": usual / NS_PER_MS,
        }
        places = timing.places(late.tolist(), late.tolist())
        found.append(make("late_messages", *name, numbers, places=places, count=len(late)))
    if usual > settings.latency_periods * timing.period_ns:
        numbers = {"usual_delay_ms": usual / NS_PER_MS, "periods": usual / timing.period_ns}
        found.append(make("latency", *name, numbers, places=[timing.place(0, len(timing) - 1)]))
    lead = -max(NS_PER_MS, 0.01 * timing.period_ns)
    if delay.min() < lead:
        early = np.flatnonzero(delay < lead)
        numbers = {"largest_lead_ms": -float(delay.min()) / NS_PER_MS}
        places = timing.places(early.tolist(), early.tolist())
        found.append(make("logged_before_published", *name, numbers, places=places, count=len(early)))
    return found, late


def _drift(name: Name, clocks: str, difference: Index, timing: Timing, settings: CheckSettings) -> list[Finding]:
    """A straight line through the medians of blocks; what the blocks scatter about it must not explain the slope."""
    level = _blocks(difference)
    if len(level) < 8:
        return []
    at = np.linspace(0, len(timing), len(level) + 1)[:-1].astype(np.int64)
    t_s = (timing.t_ns[at] - timing.t_ns[0]) / 1e9
    keep = timing.epoch[at] == timing.epoch[at[0]]
    t_s, level = t_s[keep], level[keep] - level[0]
    span = float(np.ptp(t_s)) if len(t_s) >= 8 else 0.0
    if span <= 0:
        return []
    t_s, level = t_s - t_s.mean(), level - level.mean()
    slope = float(t_s @ level) / float(t_s @ t_s)
    scatter = float(np.std(level - slope * t_s))
    apart = abs(slope) * span
    if abs(slope) / 1e3 <= settings.drift_ppm or apart < max(6 * scatter, NS_PER_MS / 100):
        return []
    numbers: dict[str, float | int | str] = {
        "clocks": clocks,
        "drift_ppm": slope / 1e3,
        "largest_apart_ms": apart / NS_PER_MS,
    }
    return [make("clock_drift", *name, numbers, places=[timing.place(0, len(timing) - 1)])]
