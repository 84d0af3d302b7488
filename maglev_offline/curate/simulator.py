"""What the simulator says of a state and a held voltage: the same step and the same cost as the agents' environment.

States are deviations from the equilibrium and are taken about the plant's own set-point, where agents train, whatever
set-point the log had: that is what a row in the buffer says to them. No random force acts.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State, step
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]


class Held(NamedTuple):
    """`next_state` [n, 3] (deviation, SI units), `cost` [n] with the contact penalty, `touched` [n]: met a stop."""

    next_state: Array
    cost: Array
    touched: NDArray[np.bool_]


def hold(plant: Plant, mdp: Mdp, state: Array, voltage_v: Array, plant_steps: int | None = None) -> Held:
    """Hold v = u - u_eq [n], in volt, from the deviation `state` [n, 3] for `plant_steps` (default: one decision)."""
    rest = plant.equilibrium()
    now = State(state[:, 0] + rest.gap_m, state[:, 1], state[:, 2] + rest.current_a)
    cost, touched = np.zeros(len(state)), np.zeros(len(state), dtype=bool)
    for _ in range(plant_steps or mdp.plant_steps_per_decision):
        cost += process.stage_cost(mdp, process.deviation(plant, now), voltage_v)
        now = step(plant, now, rest.voltage_v + voltage_v, mdp.plant_step_s, integrator=mdp.integrator)
        touched |= process.contact(plant, now.gap_m)
    return Held(process.deviation(plant, now), cost + mdp.contact_penalty * touched, touched)
