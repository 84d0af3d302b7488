"""Which field of which topic is which physical signal, in which unit: the `[signals]` table of a recipe."""

import re
from typing import Literal

from pydantic import Field, field_validator, model_validator

from maglev_offline.settings import Settings

UNIT_OF_SIGNAL = {
    "gap": "m",
    "velocity": "m/s",
    "current": "A",
    "voltage": "V",
    "set_point": "m",
}
"""The canonical signals and their SI units. Gap, current and voltage are needed; the others may be missing."""

COLUMN_OF_SIGNAL = {
    "gap": "gap_m",
    "velocity": "gap_velocity_m_s",
    "current": "current_a",
    "voltage": "voltage_v",
    "set_point": "set_point_m",
}
"""The column of the samples table that holds each canonical signal."""

Clock = Literal["log_time", "publish_time", "header"]


class Signal(Settings):
    """Where one signal is found. SI value = sign * (field value + offset) * unit.

    `field` is a dotted path into the message (`state.gap`, or `magnets.2.gap` for an element of a list). `offset` is
    in the declared unit, added before the sign. `topic` overrides the table's topic pattern for this signal.
    `valid` is a range in the declared unit, after offset and sign; values outside it are quarantined.
    """

    field: str = Field(min_length=1)
    unit: str
    sign: Literal[-1, 1] = 1
    offset: float = 0.0
    topic: str | None = None
    valid: tuple[float, float] | None = None

    @field_validator("unit")
    @classmethod
    def _known_unit(cls, unit: str) -> str:
        from maglev_offline.logs.units import dimension_of

        dimension_of(unit)
        return unit


class SignalMap(Settings):
    """The `[signals]` table: a topic pattern whose named group `point` is the suspension point, and the signals.

    `clock`: `publish_time` is the default, since it is the sender's and the recorder adds no delay to it (the MCAP
    specification sets it to the log time where a sender gives none); `log_time` is the recorder's; `header` is read
    from `clock_field` in units of `clock_unit`.
    """

    topic: str
    clock: Clock = "publish_time"
    clock_field: str | None = None
    clock_unit: str = "s"
    gap: Signal
    current: Signal
    voltage: Signal
    velocity: Signal | None = None
    set_point: Signal | None = None
    context: dict[str, Signal] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _consistent(self) -> "SignalMap":
        from maglev_offline.logs.units import to_si_factor

        for pattern in {self.topic} | {s.topic for s in self.signals().values() if s.topic is not None}:
            try:
                groups = re.compile(pattern).groupindex
            except (re.error, RecursionError) as error:
                shown = pattern if len(pattern) <= 80 else f"{pattern[:80]}..."
                raise ValueError(f"topic pattern {shown!r} is no regular expression: {error}") from None
            if set(groups) - {"point"}:
                raise ValueError(f"topic pattern {pattern!r} may have one named group only, `point`")
        if (self.clock == "header") != (self.clock_field is not None):
            raise ValueError('clock = "header" and clock_field go together')
        to_si_factor(self.clock_unit, "s")
        for name, unit in UNIT_OF_SIGNAL.items():
            signal: Signal | None = getattr(self, name)
            if signal is not None:
                try:
                    to_si_factor(signal.unit, unit)
                except ValueError as error:
                    raise ValueError(f"the {name.replace('_', '-')} ({name}): {error}") from None
        for name in self.context:
            if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or name in COLUMN_OF_SIGNAL.values():
                raise ValueError(f"context column {name!r} must be a lower-case name of its own, its unit at its end")
        return self

    def signals(self) -> dict[str, Signal]:
        """All mapped signals: the canonical ones by name, then the context columns by column name."""
        canonical = {name: getattr(self, name) for name in UNIT_OF_SIGNAL}
        return {**{k: v for k, v in canonical.items() if v is not None}, **self.context}

    def point_of(self, topic: str, signal: Signal) -> str | None:
        """The suspension point that `topic` speaks of for `signal`, or None where it does not match.

        A pattern without the group `point` makes the topic itself the point, slashes turned into underscores.
        """
        match = re.fullmatch(signal.topic or self.topic, topic)
        if match is None:
            return None
        return match.groupdict().get("point") or topic.strip("/").replace("/", "_")
