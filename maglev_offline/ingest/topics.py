"""One topic alone: its messages in SI units and time order, without those that the checks put aside."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import checks, clock, segments
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.mapping import TopicPlan, to_si
from maglev_offline.logs.reader import ChannelColumns
from maglev_offline.logs.signals import SignalMap


@dataclass(frozen=True)
class CleanTopic:
    """Messages of one topic that passed the checks, n of them, in order of epoch and time.

    `values` holds each signal by name, SI units, shape [n]; `message_index` is the place within the topic in file
    order; `stretches` are the stretches without a hole; `resets` is how often the clock was set back.
    """

    topic: str
    points: tuple[str, ...]
    t_ns: NDArray[np.int64]
    message_index: NDArray[np.int64]
    values: dict[str, NDArray[np.float64]]
    stretches: segments.Stretches
    resets: int

    def put_aside(self, messages: NDArray[np.bool_], code: str, detail: str = "") -> Quarantined:
        """Entries of the ledger for some of these messages."""
        return Quarantined(
            "message",
            code,
            self.t_ns[messages],
            self.message_index[messages],
            self.topic,
            point_in_ledger(self.points),
            detail,
        )


def point_in_ledger(points: tuple[str, ...]) -> str:
    """The point that a message belongs to, empty where several share its topic."""
    return points[0] if len(points) == 1 else ""


def clean(
    columns: ChannelColumns, plan: TopicPlan, signal_map: SignalMap, settings: IngestSettings
) -> tuple[CleanTopic, list[Quarantined]]:
    """Check the messages of a topic, order them by the chosen clock and cut them into stretches.

    Every message of `columns` ends either in the clean topic or in one entry of the ledger.
    """
    n = len(columns)
    times = clock.choose(columns, signal_map.clock)
    values: dict[str, NDArray[np.float64]] = {}
    outside: dict[str, NDArray[np.bool_]] = {}
    for name, signal in plan.signals.items():
        values[name], outside[name] = to_si(name, signal, columns.values[signal.field])

    entries: list[Quarantined] = []
    index = np.arange(n)

    def put_aside(where: NDArray[np.intp], code: str, detail: str | NDArray[np.str_] = "") -> None:
        point = point_in_ledger(plan.points)
        entries.append(Quarantined("message", code, times[where], index[where], plan.topic, point, detail))

    left = np.ones(n, dtype=np.bool_)
    stamp = signal_map.clock_field or ""
    for code, masks in (
        (checks.NOT_DECODABLE, {"": ~columns.decoded}),
        (checks.NO_STAMP, {stamp: checks.no_stamp(times)}),
        (checks.NOT_FINITE, checks.not_finite(values)),
        (checks.OUT_OF_RANGE, outside),
    ):
        found = np.flatnonzero(left & np.logical_or.reduce([*masks.values(), np.zeros(n, dtype=np.bool_)]))
        put_aside(found, code, checks.named({name: mask[found] for name, mask in masks.items()}, len(found)))
        left[found] = False

    kept = np.flatnonzero(left)
    epoch = clock.epochs(times[kept], round(settings.reorder_ms * clock.NS_PER_MS))
    order = clock.time_order(times[kept], epoch)
    kept, epoch = kept[order], epoch[order]
    repeated, conflict = checks.same_time(times[kept], epoch, {name: v[kept] for name, v in values.items()})
    put_aside(kept[repeated], checks.REPEATED)
    put_aside(kept[conflict], checks.TIME_CONFLICT)
    kept, epoch = kept[~(repeated | conflict)], epoch[~(repeated | conflict)]

    longest_bridge_ns = round(settings.longest_bridge_ms * clock.NS_PER_MS)
    stretch = segments.stretch_of(times[kept], epoch, longest_bridge_ns)
    alone = segments.lone(stretch)
    put_aside(kept[alone], checks.TOO_SHORT, "a single message")
    resets = int(epoch[-1]) if len(epoch) else 0
    kept, epoch, stretch = kept[~alone], epoch[~alone], stretch[~alone]

    found_stretches = segments.stretches(times[kept], stretch, epoch, columns.file_index[kept])
    held = {name: v[kept] for name, v in values.items()}
    topic = CleanTopic(plan.topic, plan.points, times[kept], kept, held, found_stretches, resets)
    return topic, entries
