"""Do the rows lie where an agent will be? States that reference policies visit, and the share with a row nearby."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from maglev_offline import mdp as process
from maglev_offline.control.pid import PidGains, pid
from maglev_offline.control.simulate import regulate
from maglev_offline.curate.reference_value import reference_policy
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

STARTS = 10
"""Episodes begin at so many gaps, evenly over the recipe's range of starts."""

NEAR = 0.2
"""A row is near a state within this Euclidean distance, each deviation over its scale: 0.5 mm of gap by default."""

CHUNK = 100_000


def visited_states(plant: Plant, mdp: Mdp) -> dict[str, Array]:
    """Deviations [m, 3] at each decision of an episode from each start, without noise, by the name of the policy.

    `lqr`, the reference policy, decides as often as agents do; `pid`, the paper's, at every plant step, as on a train.
    """
    starts, held = np.linspace(*mdp.start_gap_m, STARTS), mdp.plant_steps_per_decision
    found = {}
    for name, law, period_s in (
        ("lqr", reference_policy(plant, mdp), held * mdp.plant_step_s),
        ("pid", pid(PidGains(), mdp.voltage_limit_v), None),
    ):
        run = regulate(plant, mdp, law, starts, mdp.episode_duration_s, control_period_s=period_s)
        states = process.deviation(plant, State(run.gap_m, run.velocity_m_s, run.current_a))
        found[name] = states[:-1:held].reshape(-1, 3)
    return found


def share_near(visited: Array, states: Array, scale: Array, distance: float = NEAR) -> float:
    """Share of the `visited` [m, 3] that have one of the `states` [n, 3] within `distance`, in units of `scale` [3].

    Exact for any n, in chunks: what has found its row is asked no more.
    """
    left = visited / scale
    for begin in range(0, len(states), CHUNK):
        if not len(left):
            break
        tree = cKDTree(states[begin : begin + CHUNK] / scale, balanced_tree=False, compact_nodes=False)
        left = left[~np.isfinite(tree.query(left, distance_upper_bound=distance)[0])]
    return (len(visited) - len(left)) / len(visited)
