"""What a state costs under the reference policy: the discounted cost-to-go of the LQR, by rollouts in the simulator."""

import math

import numpy as np
from numpy.typing import NDArray

from maglev_offline.control.feedback import Controller
from maglev_offline.control.lqi import lqr_for_mdp
from maglev_offline.curate.simulator import hold
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

REST = 1e-5
"""A rollout ends where the discount has fallen to this: what is left out is this share of a cost-to-go."""


def reference_policy(plant: Plant, mdp: Mdp) -> Controller:
    """The LQR that is held for a control period, for the process's own cost, discount and voltage limit.

    It is a policy near which a good agent ends, so advantages under it are those that an agent has to learn.
    """
    return lqr_for_mdp(plant, mdp, mdp.voltage_limit_v, discount=mdp.discount)


def value(plant: Plant, mdp: Mdp, policy: Controller, state: Array) -> Array:
    """Discounted cost-to-go [n] of the deviations `state` [n, 3] under a policy without memory, in units of cost.

    All states go as one batch, until the discount is below `REST`; after contact only where the process goes on.
    """
    decisions = math.ceil(math.log(REST) / math.log(mdp.discount))
    period_s = mdp.plant_steps_per_decision * mdp.plant_step_s
    total, weight, memory = np.zeros(len(state)), np.ones(len(state)), policy.start(state)
    for _ in range(decisions):
        held = hold(plant, mdp, state, policy.control(state, memory, period_s)[0])
        total += weight * held.cost
        weight *= mdp.discount * ~(held.touched & mdp.terminate_on_contact)
        state = held.next_state
    return total
