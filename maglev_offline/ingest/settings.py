"""The `[ingest]` table of a recipe."""

from typing import Literal

from pydantic import Field

from maglev_offline.settings import Settings


class IngestSettings(Settings):
    """How messages become uniform samples.

    `grid_ms`: period of the samples. `longest_bridge_ms`: a longer silence is a hole and ends the segment; a
    shorter one is interpolated across. `reorder_ms`: a message that comes late by at most this is sorted in; a
    greater jump back is a reset of the clock and starts a new segment. `velocity`: `logged` needs a logged
    velocity, `central_difference` estimates it from the gap, `auto` takes the logged one where it is mapped.
    `hold_tolerance_share`: a voltage that comes at most this share of a period behind a grid instant counts as there.
    `contact_tolerance_m`: a gap this near to a stop is a contact.
    """

    grid_ms: float = Field(default=100.0, ge=1, le=1000)
    longest_bridge_ms: float = Field(default=250.0, gt=0)
    reorder_ms: float = Field(default=500.0, ge=0)
    velocity: Literal["auto", "logged", "central_difference"] = "auto"
    hold_tolerance_share: float = Field(default=0.1, ge=0, lt=0.5)
    contact_tolerance_m: float = Field(default=0.0, ge=0)
