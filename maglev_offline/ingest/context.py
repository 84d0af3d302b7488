"""Context columns from topics of their own, such as the speed of the vehicle: they follow a point's stretches.

They do not make the stretches: a speed at 1 Hz is no hole in the gap.
"""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.placing import Bounds
from maglev_offline.ingest.segments import Common, Stretches, eras_of


def follow(gap: Stretches, common: Common, other: Stretches, gap_column: int = 0) -> Bounds:
    """For each stretch of a point, the messages of a context topic that its rows may draw on; shapes [m].

    These are the messages of the epoch that belongs to the same era as the stretch's gap; of several such epochs, the
    one that covers most of the stretch. `gap_column` is the gap's column in `common.parts`.
    """
    nothing = np.zeros(len(common.start_ns), dtype=np.int64)
    bounds = Bounds(nothing, nothing.copy(), nothing.copy())
    if len(other) == 0:
        return bounds
    (gap_first, gap_last), (era_first, era_last) = eras_of([gap, other])
    of_gap = common.parts[:, gap_column]
    begins = np.flatnonzero(np.concatenate([[True], other.epoch[1:] != other.epoch[:-1]]))
    ends = np.append(begins[1:], len(other)) - 1
    best: NDArray[np.int64] = np.full(len(nothing), np.iinfo(np.int64).min)
    first, stop, epoch = bounds
    for begin, end in zip(begins, ends, strict=True):
        same = (gap_last[of_gap] >= era_first[begin]) & (gap_first[of_gap] <= era_last[begin])
        # Negative where they do not overlap: it is the distance then.
        covers = np.minimum(common.end_ns, other.end_ns[end]) - np.maximum(common.start_ns, other.start_ns[begin])
        better = same & (covers > best)
        best[better] = covers[better]
        first[better], stop[better], epoch[better] = other.first[begin], other.stop[end], other.epoch[begin]
    return bounds
