"""The `[surrogate.defects]` tables of a recipe: defects for tests and demonstrations, none by default."""

from typing import Literal

from pydantic import Field

from maglev_offline.settings import Settings

SignalName = Literal["gap", "gap_velocity", "current", "voltage", "set_point"]


class _OnPoint(Settings):
    """In one log and at one point, both counted from 0; without `point`, at all of them."""

    log: int = Field(default=0, ge=0)
    point: int | None = Field(default=0, ge=0)


class _Stretch(_OnPoint):
    """From `start_s` for `duration_s`, in true time since the log began, by the time at which the sensor was read."""

    start_s: float = Field(ge=0)
    duration_s: float = Field(gt=0)


class StuckSensor(_Stretch):
    """The signal stays at its first value of the stretch."""

    signal: SignalName = "gap"


class NotANumber(_Stretch):
    """The signal is NaN."""

    signal: SignalName = "current"


class Spikes(_Stretch):
    """`count` messages of the stretch have `size` added to the signal, in the unit of the message (mm, mm/s, A, V)."""

    signal: SignalName = "gap"
    count: int = Field(default=5, ge=1)
    size: float = 4.0


class WrongUnit(_OnPoint):
    """The numbers are `factor` times what the field's unit says: 0.001 puts metres into a field in millimetres."""

    signal: SignalName = "gap"
    factor: float = 0.001


class CoarseQuantum(_OnPoint):
    """A converter of few bits: the signal comes in steps of `quantum`, in the unit of the message."""

    signal: SignalName = "gap"
    quantum: float = Field(default=0.25, gt=0)


class SaturatedSensor(_OnPoint):
    """The sensor ends at `low` and `high`, in the unit of the message. Listed are the messages that it cuts off."""

    signal: SignalName = "voltage"
    low: float
    high: float


class ClockDrift(_OnPoint):
    """One clock runs fast by `ppm` parts in a million (slow if negative), right at the log's beginning."""

    clock: Literal["log", "publish"] = "publish"
    ppm: float = 500.0


class FrozenClock(_Stretch):
    """The clock stands at its first stamp of the stretch and is right again thereafter."""

    clock: Literal["log", "publish", "both"] = "both"


class Seam(Settings):
    """Two recordings glued together at all points: at `at_s` sequences begin anew at 0, `skip_s` of the drive is
    missing though the stamps go on, and gap and set-point are higher by `gap_step_m` from there on."""

    log: int = Field(default=0, ge=0)
    at_s: float = Field(gt=0)
    skip_s: float = Field(default=5.0, ge=0)
    gap_step_m: float = 0.0005


class DuplicatedBlock(_Stretch):
    """The values of the stretch come again from `again_s` on, in place of those that were measured there."""

    again_s: float = Field(gt=0)


class TimeConflicts(_Stretch):
    """`count` messages of the stretch are followed by another of the same sequence number and publish time, whose
    signal is higher by `size`, in the unit of the message."""

    signal: SignalName = "gap"
    count: int = Field(default=3, ge=1)
    size: float = 0.5


class OtherResistance(_OnPoint):
    """The coil has `extra_ohm` more than the plant that is declared: so much more voltage drives the same current.

    The controller is taken to make up for it, so that the drive stays as it is.
    """

    extra_ohm: float = 0.36


class PlantedDefects(Settings):
    """Defects to plant, each a list of tables; they come in this order, so that each meets those before it.

    They are in the record only: the drive and its truth stay as they are.
    """

    resistance: tuple[OtherResistance, ...] = ()
    seam: tuple[Seam, ...] = ()
    duplicated_block: tuple[DuplicatedBlock, ...] = ()
    stuck: tuple[StuckSensor, ...] = ()
    spikes: tuple[Spikes, ...] = ()
    saturated: tuple[SaturatedSensor, ...] = ()
    coarse: tuple[CoarseQuantum, ...] = ()
    not_a_number: tuple[NotANumber, ...] = ()
    time_conflicts: tuple[TimeConflicts, ...] = ()
    wrong_unit: tuple[WrongUnit, ...] = ()
    clock_drift: tuple[ClockDrift, ...] = ()
    frozen_clock: tuple[FrozenClock, ...] = ()
