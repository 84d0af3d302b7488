"""Linearisation about the operating point (paper, Sec. II-B: the matrices A, B and C)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.physics.dynamics import inductance
from maglev_offline.physics.parameters import Plant


class LinearPlant(NamedTuple):
    """dz/dt = A z + B v, y = C z with z = (x - x_eq, dx/dt, i - i_eq) and v = u - u_eq, SI units."""

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Open-loop poles in rad/s, the fastest unstable one first."""
        poles = np.linalg.eigvals(self.a).astype(np.complex128)
        return poles[np.lexsort((-poles.imag, -poles.real))]


def linearise(plant: Plant, gap_m: float | None = None) -> LinearPlant:
    """Linearise the dynamics where the plant holds its mass at `gap_m` (default: the set-point)."""
    point = plant.equilibrium(gap_m)
    reach = point.gap_m + plant.pole_offset_m
    coil_h = inductance(plant, point.gap_m)
    back_emf = plant.inductance_slope_h_m * point.current_a / reach**2
    a = np.array(
        [
            [0.0, 1.0, 0.0],
            [2 * plant.gravity_m_s2 / reach, 0.0, -2 * plant.gravity_m_s2 / point.current_a],
            [0.0, back_emf / coil_h, -plant.resistance_ohm / coil_h],
        ]
    )
    return LinearPlant(a, np.array([[0.0], [0.0], [1 / coil_h]]), np.array([[1.0, 0.0, 0.0]]))
