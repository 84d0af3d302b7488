"""The `[curate.recovery]` table of a recipe: what the state recovery believes."""

from typing import Literal

from pydantic import Field

from maglev_offline.settings import Settings

LawName = Literal["pid", "cascade", "none"]
"""The law that made the logged voltage; `none`: it is not known, and the voltage is a line between two samples."""


class RecoverySettings(Settings):
    """What is believed of the law, of the sensors, and of what the plant leaves out; standard deviations, SI units.

    `law`: `pid` and `cascade` take their gains from `[control.pid]` and `[control.cascade]`; `auto` takes for each log
    that of the three which foretells its samples best. The sensors' noise is that of usual eddy-current, Hall and
    voltage sensors (a few micrometres of gap, a per mille of the current). A value that ingestion moved to its grid
    instant (its origin is not `measured`) has besides the stamp error `stamp_std_share` of the samples' period, the
    same for all signals of a sample.

    `acceleration_noise_std_m_s2` is drawn anew each plant step (100 N on 700 kg by default). `disturbance_std_m_s2`
    stays for about `disturbance_time_s`: a load a tenth off the plant's mass. `voltage_noise_std_v`: how far
    the voltage may be from the law, anew each plant step. `voltage_line_std_v`: how far it may be from the line
    where no law is known (not given: as far as samples are from the line between their neighbours).

    A segment whose squared innovations are, in the mean, more than `most_innovation` times what their covariance says
    is `not_explained_by_plant`, and so are the intervals on both sides of a single sample that is.
    """

    law: LawName | Literal["auto"] = "auto"
    gap_std_m: float = Field(default=1e-5, gt=0)
    current_std_a: float = Field(default=0.02, gt=0)
    voltage_std_v: float = Field(default=0.1, gt=0)
    velocity_std_m_s: float = Field(default=0.003, gt=0)
    stamp_std_share: float = Field(default=0.03, ge=0, lt=1)
    acceleration_noise_std_m_s2: float = Field(default=0.15, gt=0)
    disturbance_std_m_s2: float = Field(default=1.0, gt=0)
    disturbance_time_s: float = Field(default=10.0, gt=0)
    voltage_noise_std_v: float = Field(default=0.3, gt=0)
    voltage_line_std_v: float | None = Field(default=None, gt=0)
    most_innovation: float = Field(default=4.0, gt=1)
