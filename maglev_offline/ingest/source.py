"""One topic as the source of columns of a point: which policy each signal gets, and its values on the grid."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest import antialias, resample
from maglev_offline.ingest.grid import Grid
from maglev_offline.ingest.placing import Bounds, Place, bracket, place
from maglev_offline.ingest.resample import Origins, Values
from maglev_offline.ingest.segments import Common, Stretches
from maglev_offline.ingest.settings import IngestSettings, Policy
from maglev_offline.ingest.topics import CleanTopic

AS_FAST = 1.5
"""A source is faster than the grid where its period is less than the grid's over this, and slower where it is more
than the grid's times this. In between, a lost message here and there changes nothing."""

_WITHOUT_FASTER: dict[Policy, Policy] = {"filtered": "instant", "mean": "hold"}


def mean_period_ns(stretches: Stretches) -> float:
    """Mean step between the messages of a topic within its stretches, ns; infinite without a step."""
    steps = int((stretches.stop - stretches.first - 1).sum())
    # As floats: the sum over the stretches may be beyond an int64 where the times are nonsense.
    return float((stretches.end_ns - stretches.start_ns).astype(np.float64).sum()) / steps if steps else float("inf")


class Source:
    """A topic, the grid of a point, and the messages that each stretch of the point may draw on."""

    def __init__(
        self, topic: CleanTopic, grid: Grid, bounds: Bounds, settings: IngestSettings, *, context_only: bool
    ) -> None:
        self.topic, self.grid, self.bounds, self.settings = topic, grid, bounds, settings
        self.longest_ns = settings.resample.context_bridge_ns if context_only else None
        period = mean_period_ns(topic.stretches)
        self.faster = period * AS_FAST < grid.period_ns
        self.slower = period > grid.period_ns * AS_FAST
        # The grid's share of a fast source's many messages would be later values, and not late ones.
        self._tolerance_ns = round(settings.hold_tolerance_share * min(grid.period_ns, period))
        self._longer_period_ns = max(period, float(grid.period_ns))

    @cached_property
    def place(self) -> Place:
        """The rows among the topic's messages."""
        return place(self.topic.t_ns, self.grid, self.bounds, self.longest_ns)

    @cached_property
    def _filter(self) -> antialias.Filter:
        return antialias.Filter(self.place)

    def policy(self, signal: str) -> Policy:
        """How a signal comes to the grid: as the recipe says, or the plain form where the source is not faster."""
        wanted = self.settings.resample.of(signal)
        return wanted if self.faster else _WITHOUT_FASTER.get(wanted, wanted)

    def column(self, signal: str) -> tuple[Values, Origins]:
        """Values and origins of a signal on the grid, shape [rows]; a value of the state that stands for a missing
        message is `bridged`, whatever the policy."""
        rows, values = len(self.grid.t_ns), self.topic.values[signal]
        if rows == 0 or len(values) == 0:
            return np.full(rows, np.nan), np.full(rows, resample.Origin.INTERPOLATED, dtype=np.int8)
        found, origin = self._by_policy(self.policy(signal), values)
        if self._bridged is not None:
            origin = np.where(self._bridged, np.int8(resample.Origin.BRIDGED), origin)
        return found, origin

    @cached_property
    def _bridged(self) -> NDArray[np.bool_] | None:
        """Rows without a message of their own, None where there is none; context may be as old as it is told to be."""
        if self.longest_ns is not None or self.place.all_hit:
            return None
        lost = resample.bridged(self.place, self._longer_period_ns)
        return lost if lost.any() else None

    def _by_policy(self, policy: Policy, values: Values) -> tuple[Values, Origins]:
        if policy == "instant":
            return resample.at_instant(self.place, values)
        if policy == "nearest":
            return resample.nearest(self.place, values)
        if policy == "hold":
            return resample.hold(self.place, values, self._tolerance_ns)
        if policy == "mean":
            return resample.step_mean(self.place, values, self._tolerance_ns)
        return self._filter(values)

    def drawn_on(self, common: Common, signals: list[str]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Messages that the stretches span, and those of stretches that have a row; shape [messages] each."""
        filtered = any(self.policy(signal) == "filtered" for signal in signals)
        reach_ns = round(antialias.HALF_WIDTH * self.grid.period_ns) if filtered else 0

        def of(which: NDArray[np.intp] | slice) -> NDArray[np.bool_]:
            bounds = Bounds(*(part[which] for part in self.bounds))
            start, end = common.start_ns[which], common.end_ns[which]
            return bracket(self.topic.t_ns, start, end, bounds, reach_ns=reach_ns, longest_ns=self.longest_ns)

        within = of(slice(None))
        some = np.flatnonzero(self.grid.rows)
        return within, within if len(some) == len(self.grid.rows) else of(some)
