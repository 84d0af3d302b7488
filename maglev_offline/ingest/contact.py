"""Contact with a mechanical stop ends a segment: the plant there is another one."""

import numpy as np
from numpy.typing import NDArray

CONTACT = "contact"
"""Code of the rows of a contact run but the first."""

Mask = NDArray[np.bool_]


def touched_rows(touching: Mask, touch: Mask, through: NDArray[np.int64], begins: NDArray[np.int64]) -> Mask:
    """Rows in contact: those at a stop, and those since whose predecessor a message was at a stop. Shape [n].

    `touching` says which of the rows are at a stop, `touch` which of the gap's messages are, in time order.
    `through` [n] is how many messages there are up to each row's instant, `begins` the first row of each stretch. A
    bounce between two grid instants would otherwise be passed over as free motion.
    """
    if not touch.any():
        return touching
    touched = np.concatenate([[0], np.cumsum(touch)])[through]
    rows = touching.copy()
    since = touched[1:] > touched[:-1]
    since[begins[1:] - 1] = False
    rows[1:] |= since
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
