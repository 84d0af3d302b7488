"""The `[transfer]` table of a recipe: stated, and hashed, before the runs."""

from typing import Any, Literal

from pydantic import Field, PositiveFloat, field_validator, model_validator

from maglev_offline.settings import Settings

MetricName = Literal["jumpstart", "asymptote", "area", "time_to_threshold"]
AttributionKind = Literal["logs", "cells", "cost_bands"]
RowsFrom = Literal["nothing", "log", "shuffled", "random_policy", "pid"]


class ArmSettings(Settings):
    """`[transfer.arm.NAME]`: one arm, by what differs from the recipe.

    `rows`: what the buffer starts with. `log`: the curated transitions; `shuffled`: the same, each with the voltage of
    another one; `random_policy`, `pid`: as many rows of that policy in the simulator; `nothing`: an empty buffer.
    `curate` and `training`: keys of those tables that are others in this arm. `cure`: it is a candidate for a prefill
    that helps, the best of which is chosen on half of the seeds and confirmed on the others. `against`: other arms that
    it is held against, too.
    """

    rows: RowsFrom = "log"
    curate: dict[str, Any] = Field(default_factory=dict)
    training: dict[str, Any] = Field(default_factory=dict)
    cure: bool = False
    against: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _curates_what_there_is(self) -> "ArmSettings":
        if self.curate and self.rows not in ("log", "shuffled"):
            raise ValueError(f"rows = {self.rows!r} takes nothing from the logs, so there is nothing to curate")
        return self


BUILT_IN: dict[str, ArmSettings] = {
    "empty": ArmSettings(rows="nothing"),
    "prefill": ArmSettings(),
    "uncurated": ArmSettings(curate={"balance": "none"}),
    "shuffled": ArmSettings(rows="shuffled"),
    "random_policy": ArmSettings(rows="random_policy"),
    "pid": ArmSettings(rows="pid"),
}
"""Arms that every recipe may name without describing them."""


class TransferSettings(Settings):
    """What is compared, and how a difference is judged.

    `arms`: names of `BUILT_IN`, or of an `[transfer.arm.NAME]` of the recipe's own.

    `attribution`: leave out each log, each cell of the state space, or each quartile of cost in an arm of its own, and
    hold it against the arm `attributed`, which has them all: which part of the rows helps or harms.

    `control_periods_ms`: run all of it but the attribution at these control periods too, with as many seconds of
    experience, or with `other_periods_experience_share` of them; `other_periods_seeds`: with fewer seeds, the first.

    `primary_metric`: the one that the answer is about; the others are reported beside it, as exploration.

    `first_evaluations`: window of the jumpstart, from the first evaluation after a gradient step. `last_evaluations`:
    window of the asymptote. `threshold_over_lqr`: the threshold is this multiple of the LQR's cost, never taken from an
    arm that is judged. `hold_evaluations`: so many evaluations in a row must reach it. `equivalence_share`: smallest
    effect of interest, as a share of the LQR's cost, or of a run's length for the time to the threshold.
    """

    baseline: Literal["empty"] = "empty"
    primary_metric: MetricName = "area"
    arms: tuple[str, ...] = ("empty", "prefill")
    arm: dict[str, ArmSettings] = Field(default_factory=dict)
    attribution: tuple[AttributionKind, ...] = ()
    attributed: str = "prefill"
    control_periods_ms: tuple[PositiveFloat, ...] = ()
    other_periods_experience_share: float = Field(default=1.0, gt=0, le=1)
    other_periods_seeds: int | None = Field(default=None, ge=1)
    first_evaluations: int = Field(default=3, ge=1)
    last_evaluations: int = Field(default=5, ge=1)
    threshold_over_lqr: float = Field(default=1.5, gt=1)
    hold_evaluations: int = Field(default=2, ge=1)
    equivalence_share: float = Field(default=0.05, gt=0, lt=1)
    confidence: float = Field(default=0.95, gt=0.5, lt=1)
    resamples: int = Field(default=10_000, ge=100)
    seed: int = Field(default=0, ge=0)

    @field_validator("arm")
    @classmethod
    def _names_are_free(cls, arm: dict[str, ArmSettings]) -> dict[str, ArmSettings]:
        for name in arm:
            if name in BUILT_IN:
                raise ValueError(f"the arm {name!r} is built in, give yours another name")
            if not name.replace("_", "").replace("-", "").isalnum() or not name.isascii():
                raise ValueError(f"the arm {name!r} names a folder: give it letters, digits, '_' and '-' only")
        return arm

    @model_validator(mode="after")
    def _arms_are_known(self) -> "TransferSettings":
        for name in self.arms:
            if name not in self.known_arms:
                raise ValueError(f"there is no arm {name!r}, only {', '.join(self.known_arms)}")
            for other in self.known_arms[name].against:
                if other not in self.arms:
                    raise ValueError(f"the arm {name!r} is to be held against {other!r}, which is none of the arms")
        if self.attribution and self.attributed not in self.arms:
            raise ValueError(f"attributed = {self.attributed!r} is none of the arms, {list(self.arms)}")
        if self.attribution and self.known_arms[self.attributed].rows != "log":
            raise ValueError(f"attributed = {self.attributed!r} has no rows of logs, so there is nothing to leave out")
        return self

    @property
    def known_arms(self) -> dict[str, ArmSettings]:
        """All arms that can be named, by their names."""
        return BUILT_IN | self.arm
