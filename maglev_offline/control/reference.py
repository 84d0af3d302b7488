"""The classical controllers by name, and what they cost on the decision process: reference lines for agents."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from maglev_offline.control.feedback import Controller, IntegralFeedback
from maglev_offline.control.lqi import lqi, lqr_continuous, lqr_for_mdp
from maglev_offline.control.metrics import cost
from maglev_offline.control.observer import ObserverFeedback
from maglev_offline.control.pid import cascade, pid
from maglev_offline.control.settings import ControllerName, ControlSettings
from maglev_offline.control.simulate import regulate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]


def feedback_laws(
    plant: Plant, mdp: Mdp, settings: ControlSettings, voltage_limit_v: float | None
) -> dict[ControllerName, IntegralFeedback]:
    """The state feedback laws by name, for a controller that is called at every plant step."""
    return {
        "pid": pid(settings.pid, voltage_limit_v),
        "cascade": cascade(plant, settings.cascade, voltage_limit_v),
        "lqr": lqr_continuous(plant, mdp, voltage_limit_v),
        "lqi": lqi(plant, settings.lqi, voltage_limit_v),
    }


def classical_controllers(
    plant: Plant, mdp: Mdp, settings: ControlSettings, voltage_limit_v: float | None
) -> dict[ControllerName, Controller]:
    """All classical controllers by name; `lqi_ekf` is the LQI on the estimate of a filter that sees the gap only."""
    laws = feedback_laws(plant, mdp, settings, voltage_limit_v)
    return {**laws, "lqi_ekf": ObserverFeedback(plant, laws["lqi"], settings.observer)}


def classical_reference_cost(
    plant: Plant,
    mdp: Mdp,
    starts_m: Sequence[float] | Array,
    duration_s: float | None = None,
    *,
    settings: ControlSettings | None = None,
    held: bool = False,
) -> dict[str, Array]:
    """Undiscounted cost of PID, cascade, LQR and LQI on the nonlinear plant, per start.

    The duration defaults to one episode. The LQR is `lqr_for_mdp` and acts once a decision, as an agent does. The
    others act at every plant step, as they would on a train, unless `held` puts them on the control period too.
    """
    limit = mdp.voltage_limit_v
    laws = feedback_laws(plant, mdp, settings or ControlSettings(), limit)
    laws["lqr"] = lqr_for_mdp(plant, mdp, limit)
    decision_s = mdp.plant_steps_per_decision * mdp.plant_step_s
    found: dict[str, Array] = {}
    for name, law in laws.items():
        period = decision_s if held or name == "lqr" else None
        starts, duration = np.asarray(starts_m, dtype=np.float64), duration_s or mdp.episode_duration_s
        found[name] = cost(plant, mdp, regulate(plant, mdp, law, starts, duration, control_period_s=period))
    return found
