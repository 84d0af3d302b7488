"""What every classical controller here is in the end: static feedback of the deviation and of its integral.

v = k1 z1 + k2 z2 + k3 z3 + k4 * integral(z1 dt), with z = (x - x_eq, dx/dt, i - i_eq) and v = u - u_eq. More voltage
pulls the magnet up and makes the gap smaller, so gains on the gap are positive: the plant gain is negative.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from maglev_offline.physics.linear import LinearPlant

Array = NDArray[np.float64]

Memory = Any
"""What a controller carries from one call to the next; only the controller looks into it."""


class Controller(Protocol):
    """A control law on a batch of magnets; its state is explicit, so the law itself is a pure function."""

    def start(self, z: Array) -> Memory:
        """Memory at the first instant, at the deviation z [n, 3]."""

    def control(self, z: Array, memory: Memory, dt_s: float) -> tuple[Array, Memory]:
        """Voltage deviation v [n] in volt, to be held for `dt_s`, and the memory for the next call."""


def within(v: Array, limit: float | Array) -> Array:
    """`np.clip(v, -limit, limit)`, which on a few numbers takes several times as long."""
    clipped: Array = np.minimum(np.maximum(v, -limit), limit)
    return clipped


@dataclass(frozen=True)
class IntegralFeedback:
    """v = gain . (z1, z2, z3, integral of z1), clipped to +-`voltage_limit_v` (None: no limit).

    Anti-windup: the integral holds while the voltage saturates. `gain`: shape [4], or [n, 4] to give every magnet
    of the batch its own; so may the limit be an array [n].
    """

    gain: Array
    voltage_limit_v: float | Array | None = None

    def start(self, z: Array) -> Array:
        """An empty integral, shape [n], in m s."""
        return np.zeros(z.shape[:-1])

    def control(self, z: Array, memory: Array, dt_s: float) -> tuple[Array, Array]:
        """Feed back z [n, 3] and the integral [n]; return v [n] and the integral one period later."""
        v: Array = np.add.reduce(z * self.gain[..., :3], axis=-1) + self.gain[..., 3] * memory
        if self.voltage_limit_v is None:
            return v, memory + dt_s * z[..., 0]
        free = np.abs(v) <= self.voltage_limit_v
        return within(v, self.voltage_limit_v), memory + dt_s * free * z[..., 0]


def augmented(linear: LinearPlant) -> tuple[Array, Array]:
    """A [4, 4] and B [4, 1] of the plant with the integral of the gap error as its fourth state."""
    a = np.zeros((4, 4))
    a[:3, :3] = linear.a
    a[3, 0] = 1.0
    return a, np.vstack([linear.b, [[0.0]]])


def closed_loop_poles(linear: LinearPlant, gain: Array) -> NDArray[np.complex128]:
    """Poles in rad/s of the linear plant under `gain` [4], slowest first; three of them where nothing is integrated."""
    a, b = augmented(linear)
    if gain[3] == 0:
        a, b, gain = a[:3, :3], b[:3], gain[:3]
    poles = np.linalg.eigvals(a + b * gain).astype(np.complex128)
    return poles[np.lexsort((-poles.imag, -poles.real))]


def is_stable(poles: NDArray[np.complex128], euler_step_s: float | None = None) -> bool:
    """Whether the poles are stable in continuous time, or under forward Euler with steps of `euler_step_s`."""
    if euler_step_s is None:
        return bool(np.all(poles.real < 0))
    return bool(np.all(np.abs(1 + euler_step_s * poles) < 1))
