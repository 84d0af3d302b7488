"""The `[training]` and `[evaluation]` tables of a recipe."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from maglev_offline.mdp import START_GAPS_M
from maglev_offline.settings import Settings

Algorithm = Literal["ddpg", "td3"]
EngineChoice = Literal["auto", "torch", "native"]


class TrainingSettings(Settings):
    """How an agent learns. One step is one decision, one row in the buffer and, after the exploratory steps, one
    gradient step. Standard deviations are in actions scaled to [-1, 1]. What the paper gives is in changsha.toml;
    how the defaults were found is in docs/decisions/0013.

    `block`: seeds that are stepped together; a lone seed is padded to a whole block, so that its numbers do not
    depend on its company. `engine`: what does the arithmetic; `auto` takes the native kernel where there is one.
    `n_step`: rewards in a target before it bootstraps. `mixing_share`: share of each batch that comes from the prefill
    (not given: as large as its share of the filled slots); `prefill_decay_steps`: the prefill's weight falls linearly
    to 0 over the first so many steps. `cloning_weight`: pull of the actor to the prefill's actions (TD3+BC).
    `critic_root_offset`: critics learn the root of the cost-to-go, rounded below so much cost (0: the cost-to-go
    itself). `saturation_weight`: pull that keeps the actor's tanh from saturating for good.
    `checkpoint_every`: evaluations from one checkpoint of an unfinished block to the next.
    """

    algorithms: tuple[Algorithm, ...] = ("ddpg", "td3")
    seeds: int = Field(default=8, ge=1)
    first_seed: int = Field(default=0, ge=0)
    block: int = Field(default=8, ge=1)
    engine: EngineChoice = "auto"
    checkpoint_every: int = Field(default=10, ge=1)
    steps: int = Field(default=20_000, ge=1)
    exploratory_steps: int = Field(default=1_000, ge=0)
    exploratory_hold_ms: float = Field(default=10.0, gt=0)
    hidden: tuple[int, int] = (40, 40)
    batch_norm_actor: bool = False
    actor_last_layer_scale: float = Field(default=0.05, gt=0)
    batch_size: int = Field(default=100, ge=1)
    buffer_capacity: int = Field(default=1_000_000, ge=2)
    actor_learning_rate: float = Field(default=2e-3, gt=0)
    critic_learning_rate: float = Field(default=4e-3, gt=0)
    final_learning_rate_fraction: float = Field(default=0.05, gt=0, le=1)
    target_rate: float = Field(default=0.005, gt=0, le=1)
    exploration_std: float = Field(default=0.2, ge=0)
    smoothing_std: float = Field(default=0.02, ge=0)
    smoothing_clip: float = Field(default=0.5, ge=0)
    policy_delay: int = Field(default=2, ge=1)
    n_step: int = Field(default=1, ge=1)
    mixing_share: float | None = Field(default=None, ge=0, le=1)
    prefill_decay_steps: int | None = Field(default=None, ge=1)
    layer_norm_critic: bool = True
    critic_root_offset: float = Field(default=0.01, ge=0)
    cloning_weight: float = Field(default=0.0, ge=0)
    saturation_weight: float = Field(default=0.1, ge=0)

    @model_validator(mode="after")
    def _explores_within_steps(self) -> "TrainingSettings":
        if self.exploratory_steps >= self.steps:
            raise ValueError(
                f"exploratory_steps = {self.exploratory_steps} leaves no gradient step in steps = {self.steps}"
            )
        return self

    @model_validator(mode="after")
    def _returns_fit_the_buffer(self) -> "TrainingSettings":
        if self.n_step >= self.buffer_capacity:
            raise ValueError(
                f"n_step = {self.n_step} rows do not fit into buffer_capacity = {self.buffer_capacity} slots"
            )
        return self

    @model_validator(mode="after")
    def _cloning_has_rows(self) -> "TrainingSettings":
        if self.mixing_share == 0 and self.cloning_weight > 0:
            raise ValueError(
                f"cloning_weight = {self.cloning_weight:g} needs prefilled rows in the batch, and mixing_share = 0 "
                "takes none"
            )
        return self

    @property
    def seed_list(self) -> list[int]:
        """The seeds of the study."""
        return list(range(self.first_seed, self.first_seed + self.seeds))


class EvaluationSettings(Settings):
    """How a policy is judged: fixed starts, at rest, no exploration noise, no disturbance.

    `selection_gaps_m` are other starts, on which alone the best checkpoint is chosen.
    """

    every_steps: int = Field(default=1_000, ge=1)
    start_gaps_m: tuple[float, ...] = START_GAPS_M
    selection_gaps_m: tuple[float, ...] = (0.0045, 0.0065, 0.0085, 0.0095, 0.0115, 0.0125, 0.0145)
    reference_start_gap_m: float = 0.015

    @property
    def all_starts_m(self) -> NDArray[np.float64]:
        """The starts that are reported, and then those for selection."""
        return np.array([*self.start_gaps_m, *self.selection_gaps_m])

    @model_validator(mode="after")
    def _reference_is_a_start(self) -> "EvaluationSettings":
        if self.reference_start_gap_m not in self.start_gaps_m:
            raise ValueError("reference_start_gap_m must be one of start_gaps_m")
        return self
