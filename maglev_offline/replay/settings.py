"""The `[prefill]` table of a recipe."""

from pydantic import Field

from maglev_offline.settings import Settings


class PrefillSettings(Settings):
    """What goes into the buffer before training.

    `rows`: at most so many of the curated transitions, drawn with `seed` (all, where it is not given).
    """

    rows: int | None = Field(default=None, ge=1)
    seed: int = Field(default=0, ge=0)
