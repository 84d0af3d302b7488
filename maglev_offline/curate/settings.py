"""The `[curate]` table of a recipe."""

from pydantic import Field

from maglev_offline.settings import Settings


class CurateSettings(Settings):
    """Which transitions are kept.

    State and action are cut into `bins_*` cells between the `edge_quantile` and its complement; every cell gives
    as many rows as the fullest can spare, until there are `target_rows`. `low_cost_quantile` says what counts as a
    low-cost row in the coverage report. `validation_share` of the logs (whole logs, never rows) are held out.
    """

    target_rows: int = Field(default=10_000, ge=1)
    seed: int = Field(default=0, ge=0)
    bins_gap: int = Field(default=10, ge=1, le=1000)
    bins_velocity: int = Field(default=10, ge=1, le=1000)
    bins_current: int = Field(default=10, ge=1, le=1000)
    bins_voltage: int = Field(default=10, ge=1, le=1000)
    edge_quantile: float = Field(default=0.005, ge=0, lt=0.5)
    low_cost_quantile: float = Field(default=0.25, gt=0, lt=1)
    validation_share: float = Field(default=0.0, ge=0, lt=1)
