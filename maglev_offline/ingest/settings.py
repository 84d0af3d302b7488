"""The `[ingest]` table of a recipe."""

from typing import Literal

from pydantic import Field, field_validator

from maglev_offline.settings import Settings

NS_PER_MS = 1_000_000

Policy = Literal["instant", "nearest", "hold", "mean", "filtered"]
"""How a signal comes to a grid instant.

`instant`: its value there, on a straight line between two messages if need be. `nearest`: the nearest message.
`hold`: the latest message. `mean`: its mean over the step to follow, each message held. `filtered`: a zero-phase
low-pass below the Nyquist frequency of the grid. The last two need a source that is faster than the grid; otherwise
`mean` is `hold`, and `filtered` is `instant`.
"""


class ResampleSettings(Settings):
    """The `[ingest.resample]` table: the policy of each signal, see docs/decisions/0008.

    `context` holds for all context columns but those named in `columns`. A context column is said for at most
    `context_bridge_ms` from its messages, and is NaN beyond. `slower`: what becomes of rows in which a state signal
    was interpolated because its source is slower than the grid; `mark` keeps them, their origin says so, and
    `leave_out` puts them into the ledger.
    """

    gap: Policy = "instant"
    velocity: Policy = "instant"
    current: Policy = "instant"
    voltage: Policy = "hold"
    set_point: Policy = "hold"
    context: Policy = "filtered"
    columns: dict[str, Policy] = Field(default_factory=dict)
    context_bridge_ms: float = Field(default=2500.0, gt=0, le=3_600_000)
    slower: Literal["mark", "leave_out"] = "mark"

    def of(self, signal: str) -> Policy:
        """Policy of a canonical signal, or of a context column."""
        canonical: dict[str, Policy] = {
            "gap": self.gap,
            "velocity": self.velocity,
            "current": self.current,
            "voltage": self.voltage,
            "set_point": self.set_point,
        }
        return canonical.get(signal) or self.columns.get(signal, self.context)

    @property
    def context_bridge_ns(self) -> int:
        """How far from its messages a context column is said, ns."""
        return round(self.context_bridge_ms * NS_PER_MS)


class IngestSettings(Settings):
    """How messages become uniform samples.

    `grid_ms`: period of the samples, a whole number of nanoseconds. `longest_bridge_ms`: a longer silence is a hole
    and ends the segment; a shorter one is interpolated across. `reorder_ms`: a message that comes late by at most this
    is sorted in; a greater jump back is a reset of the clock and starts a new segment. `velocity`: `logged` needs a
    logged velocity, `central_difference` estimates it from the gap, `auto` takes the logged one where it is mapped.
    `hold_tolerance_share`: a held signal that comes at most this share of a period behind a grid instant counts as
    there (of the grid's period or the source's, whichever is less). `contact_tolerance_m`: a gap this near to a stop
    is a contact.
    """

    grid_ms: float = Field(default=100.0, ge=1, le=1000)
    longest_bridge_ms: float = Field(default=250.0, gt=0, le=3_600_000)
    reorder_ms: float = Field(default=500.0, ge=0)
    velocity: Literal["auto", "logged", "central_difference"] = "auto"
    hold_tolerance_share: float = Field(default=0.1, ge=0, lt=0.5)
    contact_tolerance_m: float = Field(default=0.0, ge=0)
    resample: ResampleSettings = ResampleSettings()

    @field_validator("grid_ms")
    @classmethod
    def _whole_nanoseconds(cls, grid_ms: float) -> float:
        if round(grid_ms * NS_PER_MS) / NS_PER_MS != grid_ms:
            near = round(grid_ms * NS_PER_MS) / NS_PER_MS
            raise ValueError(f"{grid_ms!r} ms is no whole number of nanoseconds; write {near!r}")
        return grid_ms

    @property
    def grid_ns(self) -> int:
        """Period of the samples, ns."""
        return round(self.grid_ms * NS_PER_MS)

    def bridge_ns(self, *, context_only: bool) -> int:
        """The longest silence within a stretch of a topic, ns; longer for one that carries context columns only."""
        longest = round(self.longest_bridge_ms * NS_PER_MS)
        return max(longest, self.resample.context_bridge_ns) if context_only else longest
