"""Which starts, masses and voltage limits a controller survives: one batch of simulations for each controller."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.control.feedback import Controller, IntegralFeedback
from maglev_offline.control.observer import ObserverFeedback
from maglev_offline.control.reference import classical_controllers, period_s
from maglev_offline.control.settings import ControllerName, ControlSettings
from maglev_offline.control.simulate import regulate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

STEADY_SHARE = 0.2
"""The last part of a response, in which a controller that survives touches no stop."""


class Survival(NamedTuple):
    """What one controller makes of a list of cases, each array of shape [cases].

    `survives`: no stop is touched over the last 20 % of the response. `worst_error_m`: largest |gap error| in it.
    """

    start_gap_m: Array
    mass_kg: Array
    voltage_limit_v: Array
    survives: NDArray[np.bool_]
    worst_error_m: Array


def survival(
    plant: Plant,
    mdp: Mdp,
    settings: ControlSettings,
    start_gap_m: Array,
    mass_kg: Array,
    voltage_limit_v: Array,
) -> dict[ControllerName, Survival]:
    """Try every classical controller on cases [n] of start, mass and voltage limit, all cases as one batch.

    The controllers are designed for `plant` and keep its equilibrium; the plant that moves has the case's mass.
    """
    start, mass, limit = (np.ascontiguousarray(x, dtype=np.float64) for x in (start_gap_m, mass_kg, voltage_limit_v))
    actual = plant.model_copy(update={"mass_kg": mass})
    bounded = mdp.model_copy(update={"voltage_limit_v": limit})
    found: dict[ControllerName, Survival] = {}
    for name, controller in classical_controllers(plant, mdp, settings, mdp.voltage_limit_v).items():
        response = regulate(
            plant,
            bounded,
            _limited(controller, limit),
            start,
            settings.robustness_duration_s,
            control_period_s=period_s(name, mdp),
            integrator=settings.integrator,
            actual=actual,
        )
        steady = response.gap_m[-max(1, round(STEADY_SHARE * len(response.gap_m))) :]
        touched = np.any(process.contact(plant, steady), axis=0)
        found[name] = Survival(
            start, mass, limit, np.logical_not(touched), np.abs(steady - plant.set_point_m).max(axis=0)
        )
    return found


def _limited(controller: Controller, limit: Array) -> Controller:
    """The same law with a voltage limit for each case, so that its anti-windup knows where it saturates."""
    if isinstance(controller, ObserverFeedback):
        law = IntegralFeedback(controller.law.gain, limit)
        return ObserverFeedback(controller.plant, law, controller.settings)
    assert isinstance(controller, IntegralFeedback)
    return IntegralFeedback(controller.gain, limit)


class RobustnessMaps(NamedTuple):
    """The axes of the two maps, and the cases of both in the order start slow, mass or limit fast."""

    start_gap_m: Array
    mass_kg: Array
    voltage_limit_v: Array
    by_mass: dict[ControllerName, Survival]
    by_limit: dict[ControllerName, Survival]


def robustness_maps(plant: Plant, mdp: Mdp, settings: ControlSettings) -> RobustnessMaps:
    """Start against mass at the process's voltage limit, and start against voltage limit at the nominal mass."""
    n = settings.robustness_cells
    margin = 0.01 * (plant.gap_max_m - plant.gap_min_m)
    start = np.linspace(plant.gap_min_m + margin, plant.gap_max_m - margin, n)
    mass = plant.mass_kg * np.linspace(1 - settings.robustness_mass_share, 1 + settings.robustness_mass_share, n)
    limit = mdp.voltage_limit_v * np.linspace(1 / n, 1.5, n)
    starts, masses, limits = np.repeat(start, n), np.tile(mass, n), np.tile(limit, n)
    nominal_mass, nominal_limit = np.full(n * n, plant.mass_kg), np.full(n * n, mdp.voltage_limit_v)
    both = survival(
        plant,
        mdp,
        settings,
        np.concatenate([starts, starts]),
        np.concatenate([masses, nominal_mass]),
        np.concatenate([nominal_limit, limits]),
    )
    by_mass, by_limit = (
        {name: _part(cases, part) for name, cases in both.items()} for part in (slice(0, n * n), slice(n * n, None))
    )
    return RobustnessMaps(start, mass, limit, by_mass, by_limit)


def _part(cases: Survival, part: slice) -> Survival:
    return Survival(
        cases.start_gap_m[part],
        cases.mass_kg[part],
        cases.voltage_limit_v[part],
        cases.survives[part],
        cases.worst_error_m[part],
    )
