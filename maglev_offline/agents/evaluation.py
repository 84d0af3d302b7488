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


def _roll_out(actor: Actor, plant: Plant, mdp: Mdp, starts_m: Array) -> Trajectory:
    return regulate(
        plant,
        mdp,
        PolicyFeedback(actor, mdp),
        np.tile(starts_m, len(actor["w3"])),
        mdp.episode_duration_s,
        control_period_s=mdp.control_period_ms / 1e3,
    )


def evaluate(actor: Actor, plant: Plant, mdp: Mdp, evaluation: EvaluationSettings) -> pd.DataFrame:
    """Judge the actors of a block, one row for a seed.

    `cost` (and `return` = -cost), `gap_rmse_m`, `contact_fraction` and `saturation_fraction` are means over the
    starts, `worst_bias_m` is the largest |steady-state bias| of them; `settling_time_s` (NaN: never), `overshoot` and
    `steady_state_bias_m` belong to the reference start; `selection_cost` to the selection starts alone.
    """
    starts = np.array([*evaluation.start_gaps_m, *evaluation.selection_gaps_m])
    reported, seeds = len(evaluation.start_gaps_m), len(actor["w3"])
    found = response_metrics(plant, mdp, _roll_out(actor, plant, mdp, starts))
    of = {name: values.reshape(seeds, len(starts)) for name, values in found.items()}
    reference = evaluation.start_gaps_m.index(evaluation.reference_start_gap_m)
    cost = of["cost"][:, :reported].mean(axis=1)
    return pd.DataFrame(
        {
            "return": -cost,
            "cost": cost,
            "selection_cost": of["cost"][:, reported:].mean(axis=1),
            "gap_rmse_m": of["gap_rmse_m"][:, :reported].mean(axis=1),
            "worst_bias_m": np.abs(of["steady_state_bias_m"][:, :reported]).max(axis=1),
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


def regulation(actor: Actor, seeds: list[int], plant: Plant, mdp: Mdp, evaluation: EvaluationSettings) -> pd.DataFrame:
    """Responses of the actors of a block from the reference start, one row for a seed and a plant step."""
    response = _roll_out(actor, plant, mdp, np.array([evaluation.reference_start_gap_m]))
    steps = len(response.voltage_v)
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
            **{name: np.ascontiguousarray(values[:steps].T).ravel() for name, values in columns.items()},
        }
    )
