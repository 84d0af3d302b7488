"""One topic alone: its messages in SI units and time order, without those that the checks put aside."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import clock, rules, segments
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.select import Chosen
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.columns import ChannelColumns
from maglev_offline.logs.mapping import TopicPlan, to_si
from maglev_offline.logs.signals import UNIT_OF_SIGNAL, SignalMap

Broken = tuple[str, dict[str, NDArray[np.bool_]]]
"""A rule's code, and the messages that break it by the name of what is wrong in them, each of shape [n]."""


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
    columns: ChannelColumns,
    plan: TopicPlan,
    signal_map: SignalMap,
    settings: IngestSettings,
    *,
    index: NDArray[np.int64] | None = None,
    chosen: Chosen | None = None,
) -> tuple[CleanTopic, list[Quarantined]]:
    """Check the messages of a topic, order them by the chosen clock and cut them into stretches.

    Every message of `columns` ends either in the clean topic or in one entry of the ledger. `index` [n] is the place
    of each within the topic in file order, by default from 0. `chosen` says which messages the user asked for.
    """
    place = np.arange(len(columns)) if index is None else index
    times = clock.choose(columns, signal_map.clock)
    values: dict[str, NDArray[np.float64]] = {}
    outside: dict[str, NDArray[np.bool_]] = {}
    for name, signal in plan.signals.items():
        values[name], outside[name] = to_si(name, signal, columns.values[signal.field])
    aside = _Aside(plan, times, place)
    broken: list[Broken] = [
        (rules.NOT_DECODABLE, {"": ~columns.decoded}),
        (rules.NO_STAMP, {signal_map.clock_field or "": rules.no_stamp(times)}),
        (rules.NOT_FINITE, rules.not_finite(values)),
        (rules.OUT_OF_RANGE, outside),
    ]
    left = _usable(len(columns), broken, chosen, aside)

    whole = bool(left.all())
    kept = np.arange(len(columns)) if whole else np.flatnonzero(left)
    in_use = times if whole else times[kept]
    epoch = np.zeros(len(kept), dtype=np.int32)
    if len(in_use) and not (in_use[1:] > in_use[:-1]).all():  # otherwise they are in order already, each time once
        epoch = clock.epochs(in_use, round(settings.reorder_ms * clock.NS_PER_MS))
        order = clock.time_order(in_use, epoch)
        kept, epoch = kept[order], epoch[order]
        repeated, conflict = rules.same_time(times[kept], epoch, {name: v[kept] for name, v in values.items()})
        aside.put(kept[repeated], rules.REPEATED)
        aside.put(kept[conflict], rules.TIME_CONFLICT)
        kept, epoch = kept[~(repeated | conflict)], epoch[~(repeated | conflict)]
        whole = False
        in_use = times[kept]

    only_context = not any(name in UNIT_OF_SIGNAL for name in plan.signals)
    stretch = segments.stretch_of(in_use, epoch, settings.bridge_ns(context_only=only_context))
    alone = np.zeros(len(stretch), dtype=np.bool_) if only_context else segments.lone(stretch)
    resets = int(epoch[-1]) if len(epoch) else 0
    if alone.any():
        aside.put(kept[alone], rules.TOO_SHORT, "a single message")
        kept, epoch, stretch = kept[~alone], epoch[~alone], stretch[~alone]
        whole = False

    file_index = columns.file_index
    if not whole:  # taking all of them would be a copy of the topic for nothing
        times, place, file_index = times[kept], place[kept], file_index[kept]
        values = {name: v[kept] for name, v in values.items()}
    found = segments.stretches(times, stretch, epoch, file_index)
    return CleanTopic(plan.topic, plan.points, times, place, values, found, resets), aside.entries


class _Aside:
    """Collects what is put aside of a topic's messages, whose times and places have shape [n]."""

    def __init__(self, plan: TopicPlan, times: NDArray[np.int64], place: NDArray[np.int64]) -> None:
        self._plan, self._times, self._place = plan, times, place
        self.entries: list[Quarantined] = []

    def put(self, rows: NDArray[np.intp], code: str, detail: str | NDArray[np.str_] = "") -> None:
        """Put some messages aside; none make no entry."""
        if len(rows):
            point, topic = point_in_ledger(self._plan.points), self._plan.topic
            self.entries.append(
                Quarantined("message", code, self._times[rows], self._place[rows], topic, point, detail)
            )


def _usable(n: int, broken: list[Broken], chosen: Chosen | None, aside: _Aside) -> NDArray[np.bool_]:
    """Messages that are asked for and hold what they should, shape [n]; the first rule that is broken counts."""
    left = np.ones(n, dtype=np.bool_)
    if chosen is not None and not chosen.keep.all():
        aside.put(np.flatnonzero(~chosen.keep), chosen.code, chosen.detail)
        left = chosen.keep.copy()
    for code, masks in broken:
        if any(mask.any() for mask in masks.values()):
            found = np.flatnonzero(left & np.logical_or.reduce(list(masks.values())))
            aside.put(found, code, rules.named({name: mask[found] for name, mask in masks.items()}, len(found)))
            left[found] = False
    return left
