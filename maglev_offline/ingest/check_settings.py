"""The `[checks]` table of a recipe: from where on a check has something to say."""

from pydantic import Field

from maglev_offline.settings import Settings


class CheckSettings(Settings):
    """Thresholds of the checks of a log. A share is of all, between 0 and 1.

    Recording. `declared_period_ms`: the period that the topics should have; none: what the log shows is not held
    against anything. `period_tolerance`: by what share the observed period may be off it, or off the grid's.
    `jitter_share`: jitter above this share of the period is told, above `jitter_warning_share` with a warning.
    `late_periods`: a message that is recorded later than its stamp by this many periods more than usual is late.
    `latency_periods`: the usual delay of recording may be this many periods. `drift_ppm`: two clocks may run apart by
    this much. `clock_jump_periods`: a step of one clock against the other by more periods is a jump.
    `frozen_messages`: so many messages in a row with one time are a clock that stands. `most_dropped`: more messages
    missing in a row are a hole, and are not counted as dropped.

    Signals. `stuck_messages`: a signal with one value in so many messages in a row, while others move, is stuck;
    `moving_share` is how much of its spread another signal must move by. `quantum_share`: a quantum above this share
    of the plant's operating value is told, and above `quantum_spread_share` of the signal's standard deviation.
    `saturation_share`: so many messages at one extreme are saturation. `range_tolerance`: a gap may pass a stop by
    this share of the travel, and a current 0 by this share of the operating value. `unit_factor`: typical values this
    many times off the plant's are in another unit. `spike_factor`: how many times the usual bend of a signal a spike
    has.

    Use. `resistance_tolerance`: the voltage may ask for a resistance this share off the declared one. `window_s` and
    `window_rows`: over at least so much the voltage is integrated. `contact_share`: contact above this share of rows is
    a warning. `largest_phase_rad`: the plant's fastest mode may turn by this much for each row.
    `smallest_action_variance`: less of the voltage's variance left by the state is a warning.
    """

    declared_period_ms: float | None = Field(default=None, gt=0)
    period_tolerance: float = Field(default=0.05, gt=0, lt=1)
    jitter_share: float = Field(default=0.02, gt=0)
    jitter_warning_share: float = Field(default=0.1, gt=0)
    late_periods: float = Field(default=1.0, gt=0)
    latency_periods: float = Field(default=0.5, gt=0)
    drift_ppm: float = Field(default=50.0, gt=0)
    clock_jump_periods: float = Field(default=0.5, gt=0)
    frozen_messages: int = Field(default=5, ge=2)
    most_dropped: int = Field(default=5, ge=1)
    stuck_messages: int = Field(default=100, ge=4)
    moving_share: float = Field(default=0.25, gt=0)
    quantum_share: float = Field(default=0.002, gt=0)
    quantum_spread_share: float = Field(default=0.2, gt=0)
    saturation_share: float = Field(default=0.002, gt=0, lt=1)
    range_tolerance: float = Field(default=0.02, ge=0)
    unit_factor: float = Field(default=20.0, gt=1)
    spike_factor: float = Field(default=30.0, gt=1)
    resistance_tolerance: float = Field(default=0.2, gt=0)
    window_s: float = Field(default=0.5, gt=0)
    window_rows: int = Field(default=25, ge=2)
    contact_share: float = Field(default=0.01, ge=0, le=1)
    largest_phase_rad: float = Field(default=1.5, gt=0)
    smallest_action_variance: float = Field(default=0.1, ge=0, le=1)
