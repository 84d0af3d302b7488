"""The weak form: equations of the plant averaged over windows, so that no noisy signal is ever differentiated.

With a smooth weight phi that is zero at both ends of a window and whose integral is 1, integration by parts gives
<phi, dy/dt> = -<phi', y> and <phi, d2y/dt2> = <phi'', y> (Shinbrot's modulating functions). phi is a cubic B-spline
with knots a whole number of samples apart: its sampled sums are exact for polynomials up to the third degree (the
Strang-Fix conditions), so a constant gap gives an acceleration of exactly zero even where a window has few samples.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from maglev_offline.identify.rows import FreeRows, Stretch

Array = NDArray[np.float64]

BOXES = 4
"""Moving averages in a row that make a cubic B-spline."""


@dataclass(frozen=True)
class Kernel:
    """Weights of a window: `width` samples between knots, rows `period_s` apart."""

    width: int
    period_s: float

    @property
    def half(self) -> int:
        """Rows on each side of the middle of a window."""
        return BOXES * self.width // 2

    @property
    def support(self) -> int:
        """Rows that one window covers."""
        return 2 * self.half + 1

    @cached_property
    def _spline(self) -> BSpline:
        return BSpline.basis_element((np.arange(BOXES + 1) - BOXES / 2) * self.width, extrapolate=False)

    def weights(self, order: int) -> Array:
        """The order-th derivative of phi at the rows of a window, shape [support]; sums stand for integrals over t."""
        at = np.arange(-self.half, self.half + 1, dtype=np.float64)
        spline = self._spline.derivative(order) if order else self._spline
        values: Array = np.nan_to_num(spline(at)) / self.width / self.period_s**order
        return values

    def held_weights(self, delay: float, margin: int) -> Array:
        """Weights of a voltage that each row holds for a period, `delay` samples late; shape [support + 2 margin].

        Exact for any delay, whole or not: each is the integral of phi over the time for which the row's voltage acts.
        """
        at = np.arange(-self.half - margin, self.half + margin + 2, dtype=np.float64) + delay
        edge = BOXES * self.width / 2
        whole = self._spline.antiderivative()(np.clip(at, -edge, edge))
        values: Array = np.diff(whole) / self.width
        return values


@dataclass(frozen=True)
class Windows:
    """n windows of rows. `gap` and `current` have shape [n, support], `voltage` [n, support + 2 margin], SI units.

    `stretch` [n] is the stretch that each lies in, `middle` [n] its middle row there, and `stride` the rows between.
    """

    kernel: Kernel
    margin: int
    stride: int
    gap: Array
    current: Array
    voltage: Array
    stretch: NDArray[np.int64]
    middle: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.gap)

    def take(self, chosen: NDArray[np.bool_]) -> "Windows":
        """Those windows that are chosen."""
        return Windows(
            self.kernel,
            self.margin,
            self.stride,
            self.gap[chosen],
            self.current[chosen],
            self.voltage[chosen],
            self.stretch[chosen],
            self.middle[chosen],
        )

    @cached_property
    def mean_gap(self) -> Array:
        """<phi, x> in m."""
        return self.gap @ self.kernel.weights(0)

    @cached_property
    def mean_current(self) -> Array:
        """<phi, i> in A."""
        return self.current @ self.kernel.weights(0)

    @cached_property
    def acceleration(self) -> Array:
        """<phi'', x> in m/s^2."""
        return self.gap @ self.kernel.weights(2)

    @cached_property
    def current_rate(self) -> Array:
        """-<phi', i> in A/s."""
        return -(self.current @ self.kernel.weights(1))

    def mean_voltage(self, delay: float) -> Array:
        """<phi, u> in V, of a voltage that acts `delay` samples after its row."""
        return self.voltage @ self.kernel.held_weights(delay, self.margin)


def windows(rows: FreeRows, width: int, margin: int, most: int) -> Windows:
    """All windows of the stretches, at most about `most` of them; none across the end of a stretch."""
    kernel = Kernel(width, rows.period_s)
    reach = kernel.half + margin
    fit = [len(s) >= 2 * reach + 1 for s in rows.stretches]
    room = sum(len(s) - 2 * reach for s, long in zip(rows.stretches, fit, strict=True) if long)
    stride = max(1, width // 2, -(-room // most))
    gap, current, voltage, stretch, middle = [], [], [], [], []
    for index, (s, long) in enumerate(zip(rows.stretches, fit, strict=True)):
        if not long:
            continue
        at = np.arange(reach, len(s) - reach, stride, dtype=np.int64)
        gap.append(_cut(s.gap_m, kernel.support)[at - kernel.half])
        current.append(_cut(s.current_a, kernel.support)[at - kernel.half])
        voltage.append(_cut(s.voltage_v, 2 * reach + 1)[at - reach])
        stretch.append(np.full(len(at), index, dtype=np.int64))
        middle.append(at)
    if not gap:
        none, index_of_none = np.empty((0, kernel.support)), np.empty(0, dtype=np.int64)
        return Windows(kernel, margin, stride, none, none, np.empty((0, 2 * reach + 1)), index_of_none, index_of_none)
    return Windows(
        kernel,
        margin,
        stride,
        np.concatenate(gap),
        np.concatenate(current),
        np.concatenate(voltage),
        np.concatenate(stretch),
        np.concatenate(middle),
    )


def _cut(values: Array, length: int) -> Array:
    return sliding_window_view(values, length)


def longest(stretches: tuple[Stretch, ...]) -> int:
    """Rows of the longest stretch."""
    return max((len(s) for s in stretches), default=0)
