"""The two equations of the plant on windows, and the scale of each parameter.

    electrical:  <u(t - delay)> = R <i> + u0 + d/dt <(L0 + c / (x + a)) i>
    mechanical:  <x''> = g - (c / 2 m) <i^2 / (x + a)^2>

Source: Zhao et al., Sec. II-B, with L(x) = L0 + c / (x + a) as in `physics.dynamics`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_offline.identify.settings import NAMES, IdentifySettings, Name
from maglev_offline.identify.windows import Windows
from maglev_offline.physics.dynamics import inductance
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

ELECTRICAL: tuple[Name, ...] = (
    "resistance_ohm",
    "voltage_offset_v",
    "inductance_offset_h",
    "inductance_slope_h_m",
    "pole_offset_m",
    "delay_samples",
)
MECHANICAL: tuple[Name, ...] = ("pole_offset_m", "gain_h_m_per_kg")
STATIC: tuple[Name, ...] = ("resistance_ohm", "voltage_offset_v")
"""What long averages still show where the rows are too far apart for any derivative."""

Values = dict[Name, float]


def declared_values(plant: Plant) -> Values:
    """The recipe's plant in the names of this package."""
    return {
        "resistance_ohm": plant.resistance_ohm,
        "voltage_offset_v": 0.0,
        "inductance_offset_h": plant.inductance_offset_h,
        "inductance_slope_h_m": plant.inductance_slope_h_m,
        "pole_offset_m": plant.pole_offset_m,
        "gain_h_m_per_kg": plant.inductance_slope_h_m / plant.mass_kg,
        "delay_samples": 0.0,
    }


@dataclass(frozen=True)
class Problem:
    """Windows with what is known of the plant; `dynamic` is false where only averages can be trusted."""

    windows: Windows
    plant: Plant
    dynamic: bool

    def take(self, chosen: NDArray[np.bool_]) -> "Problem":
        """The same on some of the windows."""
        return Problem(self.windows.take(chosen), self.plant, self.dynamic)

    def electrical(self, p: Values) -> Array:
        """Voltage that the parameters leave unexplained, in V, shape [n]."""
        w = self.windows
        left: Array = w.mean_voltage(p["delay_samples"]) - p["resistance_ohm"] * w.mean_current - p["voltage_offset_v"]
        if self.dynamic:
            linked = -((w.current / (w.gap + p["pole_offset_m"])) @ w.kernel.weights(1))
            left = left - p["inductance_offset_h"] * w.current_rate - p["inductance_slope_h_m"] * linked
        return left

    def pull(self, p: Values) -> Array:
        """Acceleration by the magnet's force, in m/s^2, positive upward, shape [n]."""
        w = self.windows
        pull: Array = p["gain_h_m_per_kg"] / 2 * ((w.current / (w.gap + p["pole_offset_m"])) ** 2 @ w.kernel.weights(0))
        return pull

    def mechanical(self, p: Values) -> Array:
        """Acceleration that the parameters leave unexplained, in m/s^2, shape [n]."""
        left: Array = self.windows.acceleration - self.plant.gravity_m_s2 + self.pull(p)
        return left


def scales(problem: Problem) -> Values:
    """What a change of each parameter is measured against: about the change that would double an effect.

    Resistance: typical voltage over typical current. Offset: typical voltage. Inductance offset: the declared
    inductance at the typical gap. Slope: the declared one. Pole offset: typical gap plus the declared one. Gain: that
    which balances typical rows. Delay: one sample.
    """
    w, plant = problem.windows, problem.plant
    gap = float(np.median(w.mean_gap))
    current = float(np.sqrt(np.mean(w.mean_current**2)))
    voltage = float(np.sqrt(np.mean(w.mean_voltage(0.0) ** 2)))
    reach = gap + plant.pole_offset_m
    coil = float(inductance(plant, gap))
    return {
        "resistance_ohm": max(voltage / current, plant.resistance_ohm),
        "voltage_offset_v": max(voltage, plant.resistance_ohm * current),
        "inductance_offset_h": coil,
        "inductance_slope_h_m": plant.inductance_slope_h_m,
        "pole_offset_m": reach,
        "gain_h_m_per_kg": 2 * plant.gravity_m_s2 * (reach / current) ** 2,
        "delay_samples": 1.0,
    }


def bounds(problem: Problem, scale: Values, settings: IdentifySettings) -> tuple[Values, Values]:
    """Lowest and highest value of each parameter.

    Offsets may be negative, so that an interval about zero is an honest one; the pole stays above the smallest gap.
    """
    f, declared = settings.bound_factor, declared_values(problem.plant)
    low: Values = {name: -f * scale[name] for name in NAMES}
    high: Values = {name: f * max(scale[name], abs(declared[name])) for name in NAMES}
    low["resistance_ohm"] = 0.0
    low["gain_h_m_per_kg"] = 1e-6 * scale["gain_h_m_per_kg"]
    low["pole_offset_m"] = -0.9 * max(float(problem.windows.gap.min()), 0.0)
    low["delay_samples"], high["delay_samples"] = -1.0, settings.most_delay_samples
    return low, high
