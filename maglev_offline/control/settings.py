"""The `[control]` table of a recipe."""

from typing import Literal

from pydantic import Field

from maglev_offline.control.lqi import LqiWeights
from maglev_offline.control.observer import ObserverSettings
from maglev_offline.control.pid import CascadeGains, PidGains
from maglev_offline.mdp import START_GAPS_M
from maglev_offline.physics.dynamics import Integrator
from maglev_offline.settings import Settings

ControllerName = Literal["pid", "cascade", "lqr", "lqr_held", "lqi", "lqi_ekf"]
CONTROLLERS: tuple[ControllerName, ...] = ("pid", "cascade", "lqr", "lqr_held", "lqi", "lqi_ekf")


class ControlSettings(Settings):
    """Classical controllers and the starts that they are tried from.

    `reference_start_gap_m` is the paper's start; the ten `start_gaps_m` spread evenly from half the set-point to it.
    `duration_s` lets the paper's PID settle. `stored_fully_s`: the first stretch is stored at every plant step, the
    rest every `stored_rest_period_ms`; metrics always see every step. `integrator`: default is that of the process.

    `force_noise_std_n` and `constant_load_n` push the mass (downward), which is `mass_error_share` heavier than the
    controllers believe. `claims`: also hold the paper's statements against its own plant, which takes ten seconds.

    The robustness maps have `robustness_cells` starts and as many masses (within `robustness_mass_share` of the
    nominal one) and voltage limits, each followed for `robustness_duration_s`.
    """

    reference_start_gap_m: float = Field(default=0.015, gt=0)
    start_gaps_m: tuple[float, ...] = START_GAPS_M
    duration_s: float = Field(default=10.0, gt=0)
    stored_fully_s: float = Field(default=1.0, ge=0)
    stored_rest_period_ms: float = Field(default=10.0, gt=0)
    integrator: Integrator | None = None
    force_noise_std_n: float = Field(default=0.0, ge=0)
    constant_load_n: float = 0.0
    mass_error_share: float = Field(default=0.0, gt=-1)
    seed: int = Field(default=0, ge=0)
    claims: bool = False
    robustness_cells: int = Field(default=24, ge=2, le=200)
    robustness_mass_share: float = Field(default=0.5, gt=0, lt=1)
    robustness_duration_s: float = Field(default=5.0, gt=0)
    pid: PidGains = PidGains()
    cascade: CascadeGains = CascadeGains()
    lqi: LqiWeights = LqiWeights()
    observer: ObserverSettings = ObserverSettings()

    @property
    def all_start_gaps_m(self) -> tuple[float, ...]:
        """The reference start and the others, each once, in ascending order."""
        return tuple(sorted({self.reference_start_gap_m, *self.start_gaps_m}))
