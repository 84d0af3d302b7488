"""Where messages are missing: holes, pauses and single messages that were dropped."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.checks.codes import make
from maglev_offline.ingest.checks.sequence import Sequence
from maglev_offline.ingest.checks.settings import CheckSettings
from maglev_offline.ingest.checks.timing import Timing
from maglev_offline.ingest.clock import NS_PER_MS
from maglev_offline.ingest.findings import Finding
from maglev_offline.ingest.settings import IngestSettings

Index = NDArray[np.int64]


def silences(
    name: tuple[str, str, str],
    timing: Timing,
    sequence: Sequence | None,
    ingest: IngestSettings,
    settings: CheckSettings,
) -> list[Finding]:
    """Holes and pauses (silences over the bridge), and dropped messages. `name`: log, topic, point."""
    bridge_ns = round(ingest.longest_bridge_ms * NS_PER_MS)
    found: list[Finding] = []
    if timing.period_ns == 0:
        return found
    # One comparison in the usual case: nothing is longer than one and a half periods.
    long = np.flatnonzero(timing.steps_ns > min(1.5 * timing.period_ns, bridge_ns))
    silent = long[timing.steps_ns[long] > bridge_ns]
    if len(silent):
        before, after = timing.order[silent], timing.order[silent + 1]
        lost = _missing_in(silent, timing, sequence)
        expected = timing.steps_ns[silent] / timing.period_ns - 1
        paused = np.zeros(len(silent), dtype=np.bool_) if lost is None else lost < 0.5 * expected
        for code, chosen in (("hole", ~paused), ("pause", paused)):
            if chosen.any():
                numbers = {
                    "longest_s": float(timing.steps_ns[silent[chosen]].max()) / 1e9,
                    "bridge_ms": ingest.longest_bridge_ms,
                }
                places = timing.places(before[chosen].tolist(), after[chosen].tolist())
                found.append(make(code, *name, numbers, places=places, count=int(chosen.sum())))
    return found + _dropped(name, timing, sequence, long, bridge_ns, settings)


def _missing_in(silent: Index, timing: Timing, sequence: Sequence | None) -> Index | None:
    """How many numbers are missing in each silence; None where there are no numbers to go by."""
    if sequence is None:
        return None
    rank = np.empty(len(timing), dtype=np.int64)
    rank[timing.order] = np.arange(len(timing))
    at = np.minimum(rank[sequence.before], rank[sequence.after])
    lost: Index = np.bincount(at, weights=sequence.missing, minlength=len(timing))[silent].astype(np.int64)
    return lost


def _dropped(
    name: tuple[str, str, str],
    timing: Timing,
    sequence: Sequence | None,
    long: Index,
    bridge_ns: int,
    settings: CheckSettings,
) -> list[Finding]:
    if sequence is not None:
        few = sequence.missing <= settings.most_dropped
        before, after, missing = sequence.before[few], sequence.after[few], sequence.missing[few]
    else:
        steps = timing.steps_ns[long]
        inner = long[(steps <= max(bridge_ns, (settings.most_dropped + 1.5) * timing.period_ns))]
        periods = timing.steps_ns[inner] / timing.period_ns
        # Without numbers only a whole multiple of a regular period says that something is missing.
        whole = (np.abs(periods - np.rint(periods)) < 0.25) & (np.rint(periods) >= 2)
        regular = len(long) < 0.2 * len(timing)
        inner, periods = (inner[whole], periods[whole]) if regular else (inner[:0], periods[:0])
        few = np.rint(periods) - 1 <= settings.most_dropped
        inner, missing = inner[few], np.rint(periods[few]).astype(np.int64) - 1
        before, after = timing.order[inner], timing.order[inner + 1]
    if len(before) == 0:
        return []
    total = int(missing.sum())
    numbers = {
        "missing": total,
        "of": len(timing) + total,
        "share": total / (len(timing) + total),
        "by": "sequence numbers" if sequence is not None else "period",
    }
    places = timing.places(before.tolist(), after.tolist())
    return [make("dropped_messages", *name, numbers, places=places, count=len(before))]
