"""The velocity of the gap where no log holds it: differences of the gap over the grid."""

import numpy as np
from numpy.typing import NDArray


def central_differences(gap_m: NDArray[np.float64], segment: NDArray[np.int64], period_s: float) -> NDArray[np.float64]:
    """Estimate dx/dt in m/s from grid rows, shape [n]; one-sided at the two ends of a segment.

    Rows of a segment are adjacent and `period_s` apart; a segment of one row has no velocity (NaN).

    A central difference over 2 T is exact for a parabola, and damps a sine of angular frequency w by
    sin(w T) / (w T). At the usual 10 ms that is little. At 100 ms a PID loop that turns by about 3 rad from sample to
    sample is damped to nothing or has its sign turned: such a velocity is worthless, and the rows say
    `reconstructed` so that nobody takes it for a measured one.
    """
    velocity: NDArray[np.float64] = np.full(len(gap_m), np.nan)
    if len(gap_m) < 2:
        return velocity
    velocity[1:-1] = (gap_m[2:] - gap_m[:-2]) / (2 * period_s)
    begins = np.flatnonzero(np.concatenate([[True], segment[1:] != segment[:-1]]))
    ends = np.append(begins[1:], len(gap_m)) - 1
    velocity[begins] = velocity[ends] = np.nan
    begins, ends = begins[ends > begins], ends[ends > begins]
    velocity[begins] = (gap_m[begins + 1] - gap_m[begins]) / period_s
    velocity[ends] = (gap_m[ends] - gap_m[ends - 1]) / period_s
    return velocity
