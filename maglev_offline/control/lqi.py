"""Optimal state feedback: LQI with the paper's weights (Sec. VI-B), and LQR with the decision process's own cost."""

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from maglev_offline.control.feedback import IntegralFeedback, augmented
from maglev_offline.mdp import Mdp
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant
from maglev_offline.settings import Settings

Array = NDArray[np.float64]


class LqiWeights(Settings):
    """Q = diag(gap, velocity, current, integral of the gap) and R = 1 on the voltage (paper, Sec. VI-B).

    The paper's integral weight of 1e10 makes the integral work against a constant load; 1e4 leaves it all but idle.
    """

    gap_per_m2: float = Field(default=3.16e10, ge=0)
    velocity_s2_per_m2: float = Field(default=1e7, ge=0)
    current_per_a2: float = Field(default=0.0, ge=0)
    integral_per_m2_s2: float = Field(default=1e4, gt=0)
    voltage_per_v2: float = Field(default=1.0, gt=0)


def lqi(plant: Plant, weights: LqiWeights, voltage_limit_v: float | None = None) -> IntegralFeedback:
    """Continuous LQI on the linearised plant; v = +gain . (z, integral), so the gain is minus the textbook's K."""
    import control

    a, b = augmented(linearise(plant))
    q = np.diag([weights.gap_per_m2, weights.velocity_s2_per_m2, weights.current_per_a2, weights.integral_per_m2_s2])
    gain, _, _ = control.lqr(a, b, q, np.array([[weights.voltage_per_v2]]))
    return IntegralFeedback(-np.asarray(gain, dtype=np.float64).ravel(), voltage_limit_v)


def _weights(mdp: Mdp) -> tuple[Array, Array]:
    q = np.diag([mdp.cost_gap_per_m2, mdp.cost_velocity_s2_per_m2, 0.0])
    return q, np.array([[mdp.cost_voltage_per_v2]])


def lqr_continuous(plant: Plant, mdp: Mdp, voltage_limit_v: float | None = None) -> IntegralFeedback:
    """LQR for the integral of the process's cost over continuous time, undiscounted, without an integral state."""
    import control

    linear = linearise(plant)
    gain, _, _ = control.lqr(linear.a, linear.b, *_weights(mdp))
    return IntegralFeedback(np.append(-np.asarray(gain, dtype=np.float64), 0.0), voltage_limit_v)


def held_model(plant: Plant, mdp: Mdp) -> tuple[Array, Array, Array]:
    """The linearised plant over one decision: A [3, 3] and B [3, 1] of the step, and the cost W [4, 4] of (z, v).

    The voltage is held for `mdp.plant_steps_per_decision` plant steps and W sums the stage cost over them, at the
    same instants as the environment does. The plant step is forward Euler or exact, after `mdp.integrator`.
    """
    from scipy.linalg import block_diag, expm

    linear, dt = linearise(plant), mdp.plant_step_s
    rate = np.zeros((4, 4))
    rate[:3, :3], rate[:3, 3:] = linear.a, linear.b
    one_step = np.eye(4) + dt * rate if mdp.integrator == "euler" else expm(dt * rate)
    stage = block_diag(*_weights(mdp))
    reached, total = np.eye(4), np.zeros((4, 4))
    for _ in range(mdp.plant_steps_per_decision):
        total += reached.T @ stage @ reached
        reached = one_step @ reached
    return reached[:3, :3], reached[:3, 3:], (total + total.T) / 2


def lqr_for_mdp(
    plant: Plant, mdp: Mdp, voltage_limit_v: float | None = None, discount: float = 1.0
) -> IntegralFeedback:
    """The best linear law on the linearised plant for the decisions that an agent takes; call it once a decision.

    Discrete LQR on `held_model`: the reference for agents at the same control period, which a continuous design is
    not once the voltage is held for a good part of the loop's time constant (at 10 ms it loses the magnet).
    Undiscounted by default, since an evaluation sums costs without a discount.
    """
    import control

    a, b, w = held_model(plant, mdp)
    root = np.sqrt(discount)
    gain, _, _ = control.dlqr(root * a, root * b, w[:3, :3], w[3:, 3:], w[:3, 3:])
    return IntegralFeedback(np.append(-np.asarray(gain, dtype=np.float64), 0.0), voltage_limit_v)
