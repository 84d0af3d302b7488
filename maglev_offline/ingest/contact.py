"""Contact with a mechanical stop ends a segment: the plant there is another one."""

import numpy as np
from numpy.typing import NDArray

CONTACT = "contact"
"""Code of the rows of a contact run but the first."""

Mask = NDArray[np.bool_]


def touched_rows(grid_ns: NDArray[np.int64], touching: Mask, t_ns: NDArray[np.int64], touch: Mask) -> Mask:
    """Rows in contact: those at a stop, and those since whose predecessor a message was at a stop. Shape [grid].

    `touching` says which of the rows are at a stop, `touch` which of the gap's messages (at `t_ns`, in time order)
    are. A bounce between two grid instants would otherwise be passed over as free motion.
    """
    rows = touching.copy()
    at = t_ns[touch]
    at = at[(at > grid_ns[0]) & (at <= grid_ns[-1])]
    rows[np.searchsorted(grid_ns, at)] = True
    return rows


def split(touching: Mask, segment: NDArray[np.int64]) -> tuple[Mask, NDArray[np.int64]]:
    """Split segments at their contacts; returns which rows to keep and the new segment of every row, shape [n].

    The first row of a contact run stays, as the last row of the segment that ran into it. The run's other rows go,
    and the row after the run begins a new segment. A run that begins a segment has no free row before it and goes
    as a whole.
    """
    follows = np.zeros(len(touching), dtype=np.bool_)
    follows[1:] = segment[1:] == segment[:-1]
    touched_before = np.zeros(len(touching), dtype=np.bool_)
    touched_before[1:] = touching[:-1]
    keep = ~touching | (follows & ~touched_before)
    return keep, np.cumsum(~follows | touched_before) - 1
