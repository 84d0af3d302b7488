"""The state between two samples."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.pairs import Pairs

Array = NDArray[np.float64]


def state_between(pairs: Pairs, pair: NDArray[np.int64], after_s: Array) -> Array:
    """Deviation [m, 3] of the pairs with numbers `pair` [m], `after_s` [m] seconds after their first samples.

    The gap is the cubic (Hermite) that has both logged gaps and both logged velocities, and the velocity is its
    derivative, so that gap and velocity are of one motion. Where a velocity was not logged but made from differences
    of the gap, it says nothing that the gaps do not, and gap and velocity are linear. So is the current always.
    """
    begin, end, duration = pairs.state[pair], pairs.next_state[pair], pairs.duration_s[pair]
    part = after_s / duration
    state: Array = begin + part[:, None] * (end - begin)
    smooth = pairs.velocity_logged[pair]
    p, d, begin, end = part[smooth], duration[smooth], begin[smooth], end[smooth]
    (x0, w0), (x1, w1) = begin[:, :2].T, end[:, :2].T
    rise = x1 - x0
    state[smooth, 0] = x0 + p**2 * (3 - 2 * p) * rise + d * (p * (1 - p) ** 2 * w0 - p**2 * (1 - p) * w1)
    state[smooth, 1] = 6 * p * (1 - p) * rise / d + (1 - p) * (1 - 3 * p) * w0 + p * (3 * p - 2) * w1
    return state


def voltage_between(pairs: Pairs, pair: NDArray[np.int64], after_s: Array) -> Array:
    """Voltage deviation [m] in volt, linear between the two samples; arguments as of `state_between`."""
    begin, end = pairs.voltage_v[pair], pairs.next_voltage_v[pair]
    voltage: Array = begin + after_s / pairs.duration_s[pair] * (end - begin)
    return voltage
