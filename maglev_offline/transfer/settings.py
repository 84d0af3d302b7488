"""The `[transfer]` table of a recipe: stated, and hashed, before the runs."""

from typing import Literal

from pydantic import Field

from maglev_offline.settings import Settings

ArmName = Literal["empty", "prefill"]
MetricName = Literal["jumpstart", "asymptote", "area", "time_to_threshold"]


class TransferSettings(Settings):
    """What is compared, and how a difference is judged.

    `primary_metric`: the one that the answer is about; the others are reported beside it, as exploration.

    `first_evaluations`: window of the jumpstart, from the first evaluation after a gradient step. `last_evaluations`:
    window of the asymptote. `threshold_over_lqr`: the threshold is this multiple of the LQR's cost, never taken from an
    arm that is judged. `hold_evaluations`: so many evaluations in a row must reach it. `equivalence_share`: smallest
    effect of interest, as a share of the LQR's cost, or of a run's length for the time to the threshold.
    """

    baseline: Literal["empty"] = "empty"
    primary_metric: MetricName = "area"
    arms: tuple[ArmName, ...] = ("empty", "prefill")
    first_evaluations: int = Field(default=3, ge=1)
    last_evaluations: int = Field(default=5, ge=1)
    threshold_over_lqr: float = Field(default=1.5, gt=1)
    hold_evaluations: int = Field(default=2, ge=1)
    equivalence_share: float = Field(default=0.05, gt=0, lt=1)
    confidence: float = Field(default=0.95, gt=0.5, lt=1)
    resamples: int = Field(default=10_000, ge=100)
    seed: int = Field(default=0, ge=0)
