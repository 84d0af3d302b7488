"""How policies are judged: fixed starts, no exploration noise, no disturbance, the cost of the decision process."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.agents import networks
from maglev_offline.agents.settings import EvaluationSettings
from maglev_offline.control.metrics import response_metrics
from maglev_offline.control.simulate import Trajectory, regulate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
Actor = dict[str, NDArray[np.float32]]


@dataclass(frozen=True)
class PolicyFeedback:
    """The actors of a block as a controller: the batch holds the starts of the first seed, then of the second, ...

    An actor that has diverged puts out no number; it then counts as letting go: the voltage of the equilibrium.
    """

    actor: Actor
    mdp: Mdp

    def start(self, z: Array) -> None:
        """A policy has no memory."""

    def control(self, z: Array, memory: None, dt_s: float) -> tuple[Array, None]:  # noqa: ARG002
        """Voltage deviation v [seeds x starts] for the deviations z [seeds x starts, 3]."""
        seeds = len(self.actor["w3"])
        seen = torch.from_numpy(process.observation(self.mdp, z).astype(np.float32)).reshape(seeds, -1, 3)
        with torch.no_grad():
            act = networks.act({name: torch.from_numpy(value) for name, value in self.actor.items()}, seen)
        return self.mdp.voltage_limit_v * np.nan_to_num(act.numpy().astype(np.float64)).reshape(-1), None


def roll_out(actor: Actor, plant: Plant, mdp: Mdp, starts_m: Array) -> Trajectory:
    """Let the actors of a block regulate from all starts [n] for one episode: columns [seeds x n]."""
    return regulate(
        plant,
        mdp,
        PolicyFeedback(actor, mdp),
        np.tile(starts_m, len(actor["w3"])),
        mdp.episode_duration_s,
        control_period_s=mdp.control_period_ms / 1e3,
    )


def judge(response: Trajectory, actor: Actor, plant: Plant, mdp: Mdp, evaluation: EvaluationSettings) -> pd.DataFrame:
    """Judge the actors of a block by their rollout from `evaluation.all_starts_m`, one row for a seed.

    Every number and every curve of an evaluation comes from one rollout: another batch shape may round otherwise, and
    the unstable plant makes other responses of it.

    `cost` (and `return` = -cost), `gap_rmse_m`, `contact_fraction` and `saturation_fraction` are means over the
    starts, `worst_error_m` is the largest |gap error| over the last 20 % of any of them; `settling_time_s` (NaN:
    never), `overshoot` and `steady_state_bias_m` belong to the reference start; `selection_cost` to the selection
    starts alone.
    The cost is the stage cost over a whole episode: contact neither ends it nor is it penalised, it shows in
    `contact_fraction`.
    """
    seeds, reported = len(actor["w3"]), len(evaluation.start_gaps_m)
    found = response_metrics(plant, mdp, response)
    of = {name: values.reshape(seeds, -1) for name, values in found.items()}
    reference = evaluation.start_gaps_m.index(evaluation.reference_start_gap_m)
    cost = of["cost"][:, :reported].mean(axis=1)
    return pd.DataFrame(
        {
            "return": -cost,
            "cost": cost,
            "selection_cost": of["cost"][:, reported:].mean(axis=1),
            "gap_rmse_m": of["gap_rmse_m"][:, :reported].mean(axis=1),
            "worst_error_m": of["steady_state_error_m"][:, :reported].max(axis=1),
            "steady_state_bias_m": of["steady_state_bias_m"][:, reference],
            "settling_time_s": of["settling_time_s"][:, reference],
            "overshoot": of["overshoot"][:, reference],
            "contact_fraction": of["contact_fraction"][:, :reported].mean(axis=1),
            "saturation_fraction": of["saturation_fraction"][:, :reported].mean(axis=1),
            "diverged": ~np.logical_and.reduce(
                [np.isfinite(value).all(axis=tuple(range(1, value.ndim))) for value in actor.values()]
            ),
        }
    )


def regulation(response: Trajectory, seeds: list[int], evaluation: EvaluationSettings) -> pd.DataFrame:
    """The responses from the reference start in a rollout, one row for a seed and a plant step; `seeds` come first."""
    steps = len(response.voltage_v)
    starts = len(evaluation.start_gaps_m) + len(evaluation.selection_gaps_m)
    reference = evaluation.start_gaps_m.index(evaluation.reference_start_gap_m)
    of_seed = np.arange(len(seeds)) * starts + reference
    columns = {
        "gap_m": response.gap_m,
        "gap_velocity_m_s": response.velocity_m_s,
        "current_a": response.current_a,
        "voltage_v": response.voltage_v,
    }
    return pd.DataFrame(
        {
            "seed": np.repeat(seeds, steps),
            "t_s": np.tile(response.time_s[:-1], len(seeds)),
            **{name: values[:steps, of_seed].T.ravel() for name, values in columns.items()},
        }
    )
