"""What is wrong with how a topic was recorded."""

from collections.abc import Sequence as Many
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import rules
from maglev_offline.ingest.checks import clocks
from maglev_offline.ingest.checks.codes import make
from maglev_offline.ingest.checks.levels import MEASURED
from maglev_offline.ingest.checks.sequence import Sequence, read_sequence, repeats
from maglev_offline.ingest.checks.settings import CheckSettings
from maglev_offline.ingest.checks.silences import silences
from maglev_offline.ingest.checks.timing import Timing, runs, timing
from maglev_offline.ingest.clock import NS_PER_MS
from maglev_offline.ingest.findings import MOST_PLACES, Finding, Place, Severity
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.ingest.topics import CleanTopic, point_in_ledger
from maglev_offline.logs.columns import NO_TIME, ChannelColumns
from maglev_offline.logs.signals import SignalMap

Index = NDArray[np.int64]
Name = tuple[str, str, str]


# A log may hold any number: what overflows is out of every range, and is told or passed over as such.
@np.errstate(all="ignore")
def recording_findings(
    log: str,
    columns: ChannelColumns,
    topic: CleanTopic,
    entries: Many[Quarantined],
    signal_map: SignalMap,
    ingest: IngestSettings,
    settings: CheckSettings,
    *,
    message: Index | None = None,
) -> list[Finding]:
    """Findings about the times, the order and the completeness of one topic's messages.

    Parameters
    ----------
    entries: what `clean` put aside of these columns.
    message: places of the columns' messages within the whole topic; default: the columns are the whole topic.
    """
    name = (log, topic.topic, point_in_ledger(topic.points))
    times = timing(columns, signal_map.clock, ingest, message)
    numbers = columns.sequence if len(times) == len(columns) else columns.sequence[times.row]
    sequence = read_sequence(numbers, times, round(ingest.reorder_ms * NS_PER_MS))
    compared = clocks.compare(name, columns, times, ingest, settings)
    return [
        *of_entries(name, entries, len(columns)),
        *_repeats(name, columns, times, numbers, sequence, entries),
        *_frozen(name, times, numbers, settings),
        *_back(name, times, compared.late),
        *compared.findings,
        *silences(name, times, sequence, ingest, settings),
        *_rate(name, times, ingest, settings),
        *_seams(name, topic, times, sequence, ingest),
    ]


_OF_ENTRY = {
    rules.NOT_DECODABLE: "not_decodable",
    rules.NO_STAMP: "no_time",
    rules.NOT_FINITE: "not_finite",
    rules.OUT_OF_RANGE: "out_of_valid_range",
    rules.TIME_CONFLICT: "time_conflict",
}


def of_entries(name: Name, entries: Many[Quarantined], messages: int) -> list[Finding]:
    """What the ledger says of single messages, one finding for each reason and signal."""
    found = []
    for entry in entries:
        code = _OF_ENTRY.get(entry.code)
        if code is None or entry.level != "message" or len(entry.t_ns) == 0:
            continue
        details = np.broadcast_to(np.asarray(entry.detail, dtype=np.str_), len(entry.t_ns))
        signals = np.unique(details).tolist() if code in ("not_finite", "out_of_valid_range") else [""]
        for signal in signals:
            chosen = np.flatnonzero(details == signal) if signal else np.arange(len(details))
            numbers: dict[str, float | int | str] = {"of": messages, "share": len(chosen) / max(messages, 1)}
            if signal:
                numbers["signal"] = signal
            places = _run_places(entry.t_ns[chosen], entry.message_index[chosen])
            found.append(make(code, *name, numbers, places=places, count=len(chosen)))
    return found


def _run_places(t_ns: Index, index: Index) -> list[Place]:
    """Runs of neighbouring messages as places; messages in file order."""
    order = np.argsort(index, kind="stable")
    t_ns, index = t_ns[order], index[order]
    first = np.concatenate([[0], np.flatnonzero(np.diff(index) != 1) + 1])
    last = np.concatenate([first[1:] - 1, [len(index) - 1]])
    return [
        Place(_time(t_ns[a]), _time(t_ns[b]), int(index[a]), int(index[b]))
        for a, b in zip(first[:MOST_PLACES].tolist(), last[:MOST_PLACES].tolist(), strict=True)
    ]


def _time(t_ns: np.int64) -> int | None:
    return None if t_ns == NO_TIME else int(t_ns)


def _repeats(
    name: Name,
    columns: ChannelColumns,
    times: Timing,
    numbers: Index,
    sequence: Sequence | None,
    entries: Many[Quarantined],
) -> list[Finding]:
    """By the ledger, or by number, publish time and values where the clock in use tells the two apart."""
    aside = [entry for entry in entries if entry.code == rules.REPEATED and len(entry.t_ns)]
    index = np.concatenate([entry.message_index for entry in aside]) if aside else np.empty(0, dtype=np.int64)
    t_ns = np.concatenate([entry.t_ns for entry in aside]) if aside else np.empty(0, dtype=np.int64)
    if sequence is not None and np.diff(numbers).min() <= 0:
        again = repeats(
            numbers, columns.publish_time_ns[times.row], (column[times.row] for column in columns.values.values())
        )
        new = again[~np.isin(times.message[again], index)]
        index, t_ns = np.concatenate([index, times.message[new]]), np.concatenate([t_ns, times.t_ns[new]])
    if len(index) == 0:
        return []
    places = _run_places(t_ns, index)
    return [make("repeated_messages", *name, {"of": len(columns)}, places=places, count=len(index))]


def _frozen(name: Name, times: Timing, numbers: Index, settings: CheckSettings) -> list[Finding]:
    still = times.steps_ns == 0
    if np.count_nonzero(still) < settings.frozen_messages - 1:
        return []
    # A message that came twice stands for no clock that stands: its number is the same, too.
    still &= times.epoch[times.order[1:]] == times.epoch[times.order[:-1]]
    if numbers.any():
        still &= numbers[times.order[1:]] != numbers[times.order[:-1]]
    first, last = runs(still)
    length = last - first + 2
    chosen = length >= settings.frozen_messages
    if not chosen.any():
        return []
    places = times.places(times.order[first[chosen]].tolist(), times.order[last[chosen] + 1].tolist())
    largest = {"largest_messages": int(length[chosen].max())}
    return [make("clock_frozen", *name, largest, places=places, count=int(chosen.sum()))]


def _back(name: Name, times: Timing, late: Index) -> list[Finding]:
    """Resets, and messages older than one before them that are not told as late already."""
    found: list[Finding] = []
    if times.in_order:
        return found
    if len(times.resets):
        starts = [0, *times.resets.tolist()]
        back = [int(times.t_ns[a:b].max() - times.t_ns[b]) for a, b in pairwise(starts)]
        places = times.places((times.resets - 1).tolist(), times.resets.tolist())
        found.append(
            make("clock_reset", *name, {"largest_back_s": max(back) / 1e9}, places=places, count=len(times.resets))
        )
    behind = np.zeros(len(times), dtype=np.int64)
    bounds = [0, *times.resets.tolist(), len(times)]
    for start, stop in pairwise(bounds):
        part = times.t_ns[start:stop]
        behind[start:stop] = np.maximum.accumulate(part) - part
    behind[late] = 0
    older = np.flatnonzero(behind)
    if len(older):
        largest = {"largest_back_ms": float(behind.max()) / NS_PER_MS}
        places = times.places(older.tolist(), older.tolist())
        found.append(make("out_of_order", *name, largest, places=places, count=len(older)))
    return found


def _rate(name: Name, times: Timing, ingest: IngestSettings, settings: CheckSettings) -> list[Finding]:
    if len(times) < 3 or times.period_ns == 0:
        return []
    found = []
    period_ms = times.period_ns / NS_PER_MS
    whole = [times.place(int(times.order[0]), int(times.order[-1]))]
    declared, tolerance = settings.declared_period_ms, settings.period_tolerance
    if declared is not None and abs(period_ms / declared - 1) > tolerance:
        numbers = {"period_ms": period_ms, "declared_ms": declared, "of": len(times)}
        found.append(make("rate_not_declared", *name, numbers, places=whole))
    numbers = {"period_ms": period_ms, "grid_ms": ingest.grid_ms, "of": len(times)}
    if period_ms > ingest.grid_ms * (1 + tolerance):
        found.append(make("slower_than_grid", *name, numbers, places=whole))
    elif period_ms < ingest.grid_ms * (1 - tolerance):
        found.append(make("faster_than_grid", *name, numbers, places=whole))
    steps = times.steps_ns[:: max(len(times) // _SOME_STEPS, 1)]
    near = steps[np.abs(steps - times.period_ns) <= 0.5 * times.period_ns]
    jitter_ms = float(np.std(near)) / NS_PER_MS if len(near) else 0.0
    share = jitter_ms / period_ms
    if share > settings.jitter_share:
        numbers = {"jitter_ms": jitter_ms, "period_ms": period_ms, "share_jitter": share, "of": len(times)}
        severity: Severity | None = "warning" if share > settings.jitter_warning_share else None
        found.append(make("jitter", *name, numbers, places=whole, severity=severity))
    return found


_SOME_STEPS = 4096
"""Jitter is read off so many steps."""

_RARE_STEPS = 0.01
"""A signal that steps in this share of the messages, or fewer, hardly ever steps."""

_SEAM_REACH = 2
"""Signs of a seam lie within so many messages of each other."""


def _seams(
    name: Name, topic: CleanTopic, times: Timing, sequence: Sequence | None, ingest: IngestSettings
) -> list[Finding]:
    """Where the numbers begin again and time or values jump; without numbers, where time goes back and values jump."""
    candidates = times.resets if sequence is None else sequence.restarts
    if len(candidates) == 0:
        return []
    bridge_ns = ingest.longest_bridge_ms * NS_PER_MS
    seams, signs = [], dict[str, None]()
    for at in candidates.tolist():
        here = {"sequence numbers restart": None} if sequence is not None else {}
        around = slice(max(at - _SEAM_REACH, 0), at + _SEAM_REACH)
        steps = np.diff(times.t_ns[around])
        if np.any(np.abs(times.resets - at) <= _SEAM_REACH):
            here["time goes back"] = None
        elif len(steps) and steps.max() > bridge_ns:
            here["time jumps ahead"] = None
        jumping = _jumping(topic, int(times.message[at]))
        if jumping:
            here[f"{', '.join(jumping)} jump"] = None
        if len(here) >= 2:
            seams.append(at)
            signs |= here
    if not seams:
        return []
    places = times.places([at - 1 for at in seams], seams)
    return [make("seam", *name, {"signs": ", ".join(signs)}, places=places, count=len(seams))]


def _jumping(topic: CleanTopic, message: int) -> list[str]:
    """Signals that jump between this message and the one before it by more than 8 times their usual step.

    A signal that stands still for most of the time has no usual step. A set-point or a context column that hardly ever
    steps jumps by any step; what a coarse converter gives is held against the steps that it does make.
    """
    before, after = np.flatnonzero(topic.message_index < message), np.flatnonzero(topic.message_index >= message)
    if len(before) == 0 or len(after) == 0:
        return []
    a = before[np.argmax(topic.message_index[before])]
    b = after[np.argmin(topic.message_index[after])]
    found = []
    for signal, values in topic.values.items():
        steps = np.abs(np.diff(values))
        steps = steps[np.isfinite(steps)]
        if len(steps) < 2:
            continue
        usual = float(np.median(steps))
        if usual == 0:
            made = steps[steps > 0]
            rare = signal not in MEASURED and len(made) <= _RARE_STEPS * len(steps)
            # The one step that a signal makes is the one here.
            usual = 0.0 if rare or len(made) <= 1 else float(np.median(made))
        if abs(values[b] - values[a]) > 8 * usual:
            found.append(signal)
    return found
