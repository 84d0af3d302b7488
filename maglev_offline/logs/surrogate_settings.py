"""The `[surrogate]` table of a recipe: what the simulated logs hold and how bad they are."""

from typing import Literal

from pydantic import Field, model_validator

from maglev_offline.control.pid import CascadeGains, PidGains
from maglev_offline.logs.surrogate_defect_settings import PlantedDefects
from maglev_offline.logs.writer import ENCODINGS, Encoding
from maglev_offline.settings import Settings

ControllerKind = Literal["pid", "cascade"]


class SensorNoise(Settings):
    """Standard deviation and quantum of each sensor. The velocity comes from an accelerometer, so it has a bias."""

    gap_std_m: float = Field(default=5e-6, ge=0)
    gap_quantum_m: float = Field(default=2e-6, gt=0)
    velocity_std_m_s: float = Field(default=0.002, ge=0)
    velocity_bias_std_m_s: float = Field(default=0.001, ge=0)
    velocity_quantum_m_s: float = Field(default=1e-4, gt=0)
    current_std_a: float = Field(default=0.02, ge=0)
    current_quantum_a: float = Field(default=0.005, gt=0)
    voltage_std_v: float = Field(default=0.05, ge=0)
    voltage_quantum_v: float = Field(default=0.02, gt=0)


class RecorderFaults(Settings):
    """What the recorder does to the stamps and messages. Shares are of all messages.

    Late messages come by `late_ms` after their time, which is less than the half second that ingestion waits. Holes
    are stretches without any message, `hole_spacing_s` apart on average. In the log number `clock_reset_log` (from
    0; None: in no log) all clocks jump back by `clock_reset_back_s` at `clock_reset_at_s`.
    """

    jitter_std_ms: float = Field(default=3.0, ge=0, le=10)
    latency_ms: float = Field(default=2.0, gt=0)
    late_share: float = Field(default=0.002, ge=0, le=1)
    late_ms: tuple[float, float] = (150.0, 450.0)
    dropped_share: float = Field(default=0.005, ge=0, le=1)
    repeated_share: float = Field(default=0.002, ge=0, le=1)
    hole_spacing_s: float = Field(default=300.0, gt=0)
    hole_s: tuple[float, float] = (1.0, 4.0)
    clock_reset_log: int | None = Field(default=1, ge=0)
    clock_reset_at_s: float = Field(default=330.0, gt=0)
    clock_reset_back_s: float = Field(default=45.0, gt=0)


class SurrogateSettings(Settings):
    """Simulated logs of a plant that is richer than the one that agents train in.

    A log is a series of runs. Before each run the vehicle is on its jacks with the recorder paused; a run starts at
    rest at a gap drawn from the decision process's starts, or on the lower stop without current
    (`from_stop_share`), and may see a step of the set-point. The vehicle drives for a part of each run.
    `controllers` and `encodings` cycle over the logs. The load differs from log to log.
    `defects` plants more than the recorder's faults; by default nothing.
    """

    logs: int = Field(default=3, ge=1)
    points: int = Field(default=4, ge=1)
    duration_s: float = Field(default=600.0, gt=0)
    message_period_ms: int = Field(default=100, ge=10)
    controllers: tuple[ControllerKind, ...] = Field(default=("pid", "cascade"), min_length=1)
    encodings: tuple[Encoding, ...] = Field(default=ENCODINGS, min_length=1)
    seed: int = Field(default=20, ge=0)
    run_s: tuple[float, float] = (20.0, 40.0)
    pause_s: float = Field(default=1.5, gt=0)
    from_stop_share: float = Field(default=0.1, ge=0, le=1)
    set_point_step_share: float = Field(default=0.5, ge=0, le=1)
    set_point_step_m: float = Field(default=0.001, ge=0)
    load_spread: float = Field(default=0.1, ge=0, lt=1)
    force_noise_std_n: float = Field(default=100.0, ge=0)
    rail_rms_m: float = Field(default=0.0005, ge=0)
    cruise_speed_m_s: tuple[float, float] = (3.0, 20.0)
    acceleration_m_s2: float = Field(default=1.0, gt=0)
    point_spacing_m: float = Field(default=3.0, gt=0)
    pid: PidGains = PidGains()
    cascade: CascadeGains = CascadeGains()
    sensors: SensorNoise = SensorNoise()
    recorder: RecorderFaults = RecorderFaults()
    defects: PlantedDefects = PlantedDefects()

    @model_validator(mode="after")
    def _ranges_ascend(self) -> "SurrogateSettings":
        for name in ("run_s", "cruise_speed_m_s"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} must be [smallest, largest], both above 0")
        return self
