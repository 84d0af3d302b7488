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
    n = len(gap_m)
    follows = np.zeros(n, dtype=np.bool_)
    follows[1:] = segment[1:] == segment[:-1]
    leads = np.zeros(n, dtype=np.bool_)
    leads[:-1] = follows[1:]
    rows = np.arange(n)
    ahead, behind = rows + leads, rows - follows
    span = (ahead - behind) * period_s
    velocity: NDArray[np.float64] = np.full(n, np.nan)
    np.divide(gap_m[ahead] - gap_m[behind], span, out=velocity, where=span > 0)
    return velocity
