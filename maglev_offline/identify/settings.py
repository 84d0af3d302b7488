"""The `[identify]` table of a recipe."""

from typing import Literal

from pydantic import Field, model_validator

from maglev_offline.settings import Settings

Name = Literal[
    "resistance_ohm",
    "voltage_offset_v",
    "inductance_offset_h",
    "inductance_slope_h_m",
    "pole_offset_m",
    "gain_h_m_per_kg",
    "delay_samples",
]
NAMES: tuple[Name, ...] = (
    "resistance_ohm",
    "voltage_offset_v",
    "inductance_offset_h",
    "inductance_slope_h_m",
    "pole_offset_m",
    "gain_h_m_per_kg",
    "delay_samples",
)
"""What can be fitted; `gain_h_m_per_kg` is c/m, and the delay is that of the voltage, in samples."""

Loss = Literal["linear", "soft_l1", "cauchy"]


class IdentifySettings(Settings):
    """How the plant is fitted to samples.

    `parameters`: those that are fitted; any other keeps its declared value (voltage offset and delay: 0).
    `bound_factor`: how far an estimate may lie from the scale that the declared plant gives it.
    `filter_time_constants`: width of the moving averages that the derivative filter is made of, in time constants of
    the unstable plant; four of them in a row are one window. `loss`: a robust one gives little weight to rows where
    the magnet is not free. `least_windows_per_parameter`: windows that each fitted parameter needs, laid end to end.
    `most_samples`: of more, so many are drawn by `seed`, a minute of a point at a time. `most_windows`: long
    recordings are thinned to so many. `folds`: pieces that are held out in turn where there is one log; else whole
    logs are. `warn_phase_rad`, `refuse_phase_rad`: by how much the unstable plant may turn from sample to sample.
    `identified_within`, `weak_within`: half width of the interval over the parameter's scale.
    """

    parameters: tuple[Name, ...] = NAMES
    bound_factor: float = Field(default=20.0, gt=1)
    filter_time_constants: float = Field(default=1.2, gt=0)
    loss: Loss = "soft_l1"
    least_windows_per_parameter: int = Field(default=4, ge=2)
    most_samples: int = Field(default=4_000_000, ge=1000)
    seed: int = Field(default=0, ge=0)
    most_windows: int = Field(default=20_000, ge=100)
    most_delay_samples: float = Field(default=5.0, gt=0)
    folds: int = Field(default=4, ge=2, le=20)
    warn_phase_rad: float = Field(default=1.5, gt=0)
    refuse_phase_rad: float = Field(default=3.0, gt=0)
    confidence: float = Field(default=0.95, gt=0.5, lt=1)
    identified_within: float = Field(default=0.1, gt=0)
    weak_within: float = Field(default=0.5, gt=0)
    stored_residuals: int = Field(default=2000, ge=10)

    @model_validator(mode="after")
    def _orders(self) -> "IdentifySettings":
        if not self.parameters or len(set(self.parameters)) < len(self.parameters):
            raise ValueError("parameters must name at least one parameter, and each once")
        if self.weak_within < self.identified_within:
            raise ValueError("weak_within must not be below identified_within")
        if self.refuse_phase_rad < self.warn_phase_rad:
            raise ValueError("refuse_phase_rad must not be below warn_phase_rad")
        return self
