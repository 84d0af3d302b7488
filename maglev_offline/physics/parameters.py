"""The plant: one electromagnet that carries a mass, with inductance L(x) = L0 + c / (x + a)."""

from math import inf, isfinite, pi, sqrt
from typing import Any, NamedTuple

from pydantic import Field, model_validator

from maglev_offline.settings import Settings

MU_0 = 4e-7 * pi
"""Permeability of the vacuum, H/m, as the paper writes it."""


class Equilibrium(NamedTuple):
    """The operating point at which the magnet carries the mass at rest."""

    gap_m: float
    current_a: float
    voltage_v: float


class Plant(Settings):
    """Parameters of the suspension. The gap x grows downward, away from the rail.

    L(x) = L0 + c / (x + a) is the paper's model (Zhao et al., Sec. II-B) for L0 = a = 0 and
    c = mu0 N^2 A / 2, and that of a laboratory levitator for L0, a > 0. A recipe gives either
    `inductance_slope_h_m` (c), or `coil_turns` (N) and `pole_area_m2` (A).
    The defaults are the paper's.
    """

    mass_kg: float = Field(default=700.0, gt=0)
    resistance_ohm: float = Field(default=1.2, gt=0)
    gravity_m_s2: float = Field(default=9.8, gt=0)
    coil_turns: float | None = Field(default=None, gt=0)
    pole_area_m2: float | None = Field(default=None, gt=0)
    inductance_slope_h_m: float = Field(default=MU_0 * 450**2 * 0.024 / 2, gt=0)
    inductance_offset_h: float = Field(default=0.0, ge=0)
    pole_offset_m: float = Field(default=0.0, ge=0)
    set_point_m: float = Field(default=0.008, gt=0)
    gap_min_m: float = Field(default=0.0005, ge=0)
    gap_max_m: float = Field(default=0.016, gt=0)

    @model_validator(mode="before")
    @classmethod
    def _slope_from_coil(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        turns, area = data.get("coil_turns"), data.get("pole_area_m2")
        if (turns is None) != (area is None):
            raise ValueError("coil_turns and pole_area_m2 go together: give both, or inductance_slope_h_m")
        if turns is None or not isinstance(turns, int | float) or not isinstance(area, int | float):
            return data
        try:
            slope = MU_0 * float(turns) ** 2 * area / 2  # a whole number is kept as a float, too
        except OverflowError:
            raise ValueError("coil_turns and pole_area_m2 give no finite inductance") from None
        given = data.get("inductance_slope_h_m")
        if isinstance(given, int | float) and abs(given - slope) > 1e-9 * slope:
            raise ValueError(
                f"inductance_slope_h_m = {given:g} contradicts coil_turns and pole_area_m2, "
                f"which give {slope:g}: give one or the other"
            )
        return {**data, "inductance_slope_h_m": slope}

    @model_validator(mode="after")
    def _stops_enclose_set_point(self) -> "Plant":
        if not self.gap_min_m < self.set_point_m < self.gap_max_m:
            raise ValueError(
                f"set_point_m = {self.set_point_m:g} must lie between the stops "
                f"gap_min_m = {self.gap_min_m:g} and gap_max_m = {self.gap_max_m:g}"
            )
        if self.gap_min_m + self.pole_offset_m <= 0:
            raise ValueError("gap_min_m + pole_offset_m must be above 0: the inductance is infinite there")
        point = self.equilibrium()
        if not (isfinite(point.voltage_v) and 0 < point.current_a < inf):
            raise ValueError(f"no current holds the mass: {point.current_a:g} A, {point.voltage_v:g} V")
        return self

    @property
    def kappa(self) -> float:
        """The paper's kappa = 4 m g / (mu0 N^2 A) = 2 m g / c, in A^2/m^2 (Sec. II-B)."""
        return 2 * self.mass_kg * self.gravity_m_s2 / self.inductance_slope_h_m

    def equilibrium(self, gap_m: Any = None) -> Equilibrium:
        """Return current and voltage that hold the mass at `gap_m`, a number or an array (default: the set-point)."""
        gap = self.set_point_m if gap_m is None else gap_m
        current = sqrt(self.kappa) * (gap + self.pole_offset_m)
        return Equilibrium(gap, current, self.resistance_ohm * current)
