"""What balance changed: measures of the rows before and after, for the manifest."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.balance.candidates import Candidates
from maglev_offline.curate.measures.discrepancy import discrepancies
from maglev_offline.curate.measures.occupancy import occupancy
from maglev_offline.curate.measures.visited import NEAR, share_near, visited_states
from maglev_offline.curate.measures.weights import effective_sample_size
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

LEVELS = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
"""The quantiles that stand for the distribution of the cost."""


def coverage_facts(
    candidates: Candidates,
    chosen: NDArray[np.int64],
    weight: NDArray[np.float64],
    settings: CurateSettings,
    plant: Plant,
    mdp: Mdp,
) -> dict[str, Any]:
    """All measures of the `candidates` and of the `chosen` rows, with their importance `weight`."""
    cost = candidates.cost
    low = float(np.quantile(cost, settings.low_cost_quantile))
    low_before, low_after = int((cost <= low).sum()), int((cost[chosen] <= low).sum())
    uneven = discrepancies(candidates.values, chosen, settings.edge_quantile, settings.seed)
    return {
        "balance": settings.balance,
        "occupancy_before": occupancy(candidates.cell)._asdict(),
        "occupancy_after": occupancy(candidates.cell[chosen])._asdict(),
        "effective_sample_size": effective_sample_size(weight),
        "discrepancy": uneven._asdict(),
        "visited_states": _visited(candidates.values, chosen, plant, mdp),
        "low_cost_threshold": low,
        "low_cost_rows_before": low_before,
        "low_cost_rows_after": low_after,
        "low_cost_share_kept": low_after / low_before,
        "mean_cost_before": float(cost.mean()),
        "mean_cost_after": float(cost[chosen].mean()),
        "cost_quantiles": {
            "levels": list(LEVELS),
            "before": np.quantile(cost, LEVELS).tolist(),
            "after": np.quantile(cost[chosen], LEVELS).tolist(),
        },
    }


def _visited(values: NDArray[np.float64], chosen: NDArray[np.int64], plant: Plant, mdp: Mdp) -> dict[str, Any]:
    policies = {
        name: {
            "states": len(visited),
            "before": share_near(visited, values[:, :3], mdp.state_scale),
            "after": share_near(visited, values[chosen, :3], mdp.state_scale),
        }
        for name, visited in visited_states(plant, mdp).items()
    }
    return {"distance": NEAR, "policies": policies}
