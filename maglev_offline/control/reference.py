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
    """The state feedback laws by name. `lqr_held` decides once a control period, the others at every plant step."""
    return {
        "pid": pid(settings.pid, voltage_limit_v),
        "cascade": cascade(plant, settings.cascade, voltage_limit_v),
        "lqr": lqr_continuous(plant, mdp, voltage_limit_v),
        "lqr_held": lqr_for_mdp(plant, mdp, voltage_limit_v),
        "lqi": lqi(plant, settings.lqi, voltage_limit_v),
    }


def period_s(name: ControllerName, mdp: Mdp) -> float | None:
    """Seconds for which the controller holds its voltage; None: one plant step."""
    return mdp.plant_steps_per_decision * mdp.plant_step_s if name == "lqr_held" else None


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

    The duration defaults to one episode. `lqr_held` acts once a decision, as an agent does. The others act at every
    plant step, as they would on a train, unless `held` puts them on the control period too.
    """
    laws = feedback_laws(plant, mdp, settings or ControlSettings(), mdp.voltage_limit_v)
    found: dict[str, Array] = {}
    for name, law in laws.items():
        period = period_s("lqr_held" if held else name, mdp)
        starts, duration = np.asarray(starts_m, dtype=np.float64), duration_s or mdp.episode_duration_s
        found[name] = cost(plant, mdp, regulate(plant, mdp, law, starts, duration, control_period_s=period))
    return found
