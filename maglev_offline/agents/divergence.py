"""When a run counts as diverged: a network holds no number, or a critic's value is beyond all that a state can cost."""

import numpy as np
import torch
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.agents import networks
from maglev_offline.agents.engine import Nets
from maglev_offline.agents.roots import from_root
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

BEYOND = 1e3
"""So many times the largest cost-to-go is more than learning overshoots."""

TRIED_ACTIONS = (-1.0, 0.0, 1.0)


def largest_value(plant: Plant, mdp: Mdp) -> float:
    """Discounted cost of resting at the farther stop for ever, with the voltage at its limit and any penalty."""
    gaps = np.array([plant.gap_min_m, plant.gap_max_m])
    rest = State(gaps, np.zeros(2), np.full(2, plant.equilibrium().current_a))
    stage = process.stage_cost(mdp, process.deviation(plant, rest), np.full(2, mdp.voltage_limit_v)).max()
    return float((mdp.plant_steps_per_decision * stage + mdp.contact_penalty) / (1 - mdp.discount))


def diverged(
    actors: Nets, critics: Nets, plant: Plant, mdp: Mdp, gaps_m: Array, root_offset: float
) -> NDArray[np.bool_]:
    """Which seeds have diverged, [seeds], by their networks [seeds, ...] and [critics, seeds, ...].

    The critics are asked at rest at `gaps_m` [n], with the voltage at either limit and at the equilibrium's; what they
    say is the root of a cost-to-go, with `root_offset` (`roots.py`).
    """
    finite = np.logical_and.reduce([np.isfinite(x).all(axis=tuple(range(1, x.ndim))) for x in actors.values()])
    rest = State(gaps_m, np.zeros_like(gaps_m), np.full_like(gaps_m, plant.equilibrium().current_a))
    seen = process.observation(mdp, process.deviation(plant, rest)).astype(np.float32)
    asked = torch.from_numpy(np.tile(seen, (len(TRIED_ACTIONS), 1)))
    actions = torch.from_numpy(np.repeat(TRIED_ACTIONS, len(gaps_m)).astype(np.float32))[:, None]
    with torch.no_grad():
        said = networks.value({name: torch.from_numpy(x) for name, x in critics.items()}, asked, actions)
    value = from_root(said, root_offset)
    within = (value.abs() <= BEYOND * largest_value(plant, mdp)).numpy().all(axis=(0, 2, 3))
    found: NDArray[np.bool_] = ~(finite & within)
    return found
