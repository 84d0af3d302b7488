"""The `[curate]` table of a recipe."""

from typing import Literal

from pydantic import Field, model_validator

from maglev_offline.curate.recovery.settings import RecoverySettings
from maglev_offline.curate.rules import Rule
from maglev_offline.settings import Settings

ConstructionName = Literal["raw", "semi_markov", "interpolated", "consistent", "reconstructed", "simulated_next"]
"""How rows are made from pairs of samples; see `constructions`."""

SEVERAL_ROWS: tuple[ConstructionName, ...] = ("interpolated", "consistent", "reconstructed")
"""Constructions that make a row for each control period between two samples."""

CONSISTENT_SHARE = 0.25
"""What `consistent` keeps unless the recipe says otherwise: what made interpolated 100 ms rows fit (decision 14)."""

BalanceName = Literal["cells", "quantiles", "inverse_density", "coverage", "low_cost", "none"]
"""How rows are chosen; see `balance`."""


class CurateSettings(Settings):
    """How transitions are made, and which are kept.

    `construction` says how rows come from pairs of samples. `consistent_fraction`: keep this share of the usable rows,
    those that agree best with the simulator over one step (not given: all, but 0.25 where `construction` is
    `consistent`, which are interpolated rows with this filter). A row is used where it fits one of the
    `include` rules (or there are none) and no `exclude` rule; `balance` chooses `target_rows` of what remains. State
    and action are cut into `bins_*` cells between the `edge_quantile` and its complement, in which all balances are
    measured; with `cells` every cell gives as many rows as the fullest can spare. `low_cost_quantile` says what counts
    as a low-cost row. `validation_share` of the logs (whole logs, never rows) are held out. Where the workspace has
    more than `most_samples` samples, so many are drawn, a minute of a point at a time; a construction that makes
    several rows of two samples gets as many times fewer.
    """

    construction: ConstructionName = "raw"
    consistent_fraction: float | None = Field(default=None, gt=0, le=1)
    include: tuple[Rule, ...] = ()
    exclude: tuple[Rule, ...] = ()
    balance: BalanceName = "cells"
    target_rows: int = Field(default=10_000, ge=1)
    most_samples: int = Field(default=4_000_000, ge=1000)
    seed: int = Field(default=0, ge=0)
    bins_gap: int = Field(default=10, ge=1, le=1000)
    bins_velocity: int = Field(default=10, ge=1, le=1000)
    bins_current: int = Field(default=10, ge=1, le=1000)
    bins_voltage: int = Field(default=10, ge=1, le=1000)
    edge_quantile: float = Field(default=0.005, ge=0, lt=0.5)
    low_cost_quantile: float = Field(default=0.25, gt=0, lt=1)
    validation_share: float = Field(default=0.0, ge=0, lt=1)
    recovery: RecoverySettings = RecoverySettings()

    @model_validator(mode="after")
    def _filter_has_something_to_do(self) -> "CurateSettings":
        if self.consistent_fraction is not None and self.construction == "simulated_next":
            raise ValueError(
                "consistent_fraction goes with rows of logged next states: those of construction = "
                '"simulated_next" are the simulator\'s own, and all agree with it'
            )
        return self

    @property
    def share_kept(self) -> float | None:
        """The share of the usable rows that the filter by consistency keeps; None where there is no filter."""
        if self.consistent_fraction is None and self.construction == "consistent":
            return CONSISTENT_SHARE
        return self.consistent_fraction
