"""What a response is judged by, for classical controllers and agents alike. All functions work along the first axis.

`error_m` is the gap error x - x_eq, shape [steps + 1, n]; every metric has shape [n].
"""

import numpy as np
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.control.simulate import Trajectory
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

SETTLED_FOR_S = 0.05
"""How long a response has to stay in its band at least to count as settled."""

STEADY_SHARE = 0.2
"""The last part of a response that counts as its steady state."""


def settling_time_s(time_s: Array, error_m: Array, band: float = 0.02) -> Array:
    """First time after which |error| stays within `band` of the initial deviation to the end; NaN: never.

    It has to stay for `SETTLED_FOR_S` at least: an error that crosses the band as the response ends has not settled. A
    magnet that starts at the set-point has settled at once only if it never moves.
    """
    outside = np.abs(error_m) > band * np.abs(error_m[0])
    first_inside: NDArray[np.int64] = len(outside) - np.argmax(outside[::-1], axis=0)
    never = outside[-1]
    settled = np.where(outside.any(axis=0), first_inside, 0)
    when = time_s[np.minimum(settled, len(time_s) - 1)]
    return np.where(never | (time_s[-1] - when < SETTLED_FOR_S), np.nan, when)


def overshoot(error_m: Array) -> Array:
    """Largest excursion to the other side of the set-point, as a fraction of the initial deviation; NaN without one."""
    start = error_m[0]
    beyond = np.max(-error_m * np.sign(start), axis=0).clip(0.0)
    share: Array = np.divide(beyond, np.abs(start), out=np.full_like(start, np.nan), where=start != 0)
    return share


def peak_voltage_v(plant: Plant, voltage_v: Array) -> Array:
    """Largest |u - u_eq| in volt; `voltage_v` is the total coil voltage [steps, n]."""
    peak: Array = np.abs(voltage_v - plant.equilibrium().voltage_v).max(axis=0)
    return peak


def steady_state_bias_m(error_m: Array) -> Array:
    """Mean error over the last 20 % of the response, in metres; positive: the gap is too large."""
    bias: Array = error_m[-max(1, round(STEADY_SHARE * len(error_m))) :].mean(axis=0)
    return bias


def steady_state_error_m(error_m: Array) -> Array:
    """Largest |error| over the last 20 % of the response, in metres: what a limit cycle cannot hide in a mean."""
    worst: Array = np.abs(error_m[-max(1, round(STEADY_SHARE * len(error_m))) :]).max(axis=0)
    return worst


def gap_rmse_m(error_m: Array) -> Array:
    """Root mean square of the gap error over the whole response, in metres."""
    rms: Array = np.sqrt(np.mean(error_m**2, axis=0))
    return rms


def contact_fraction(plant: Plant, gap_m: Array) -> Array:
    """Share of the instants at which the magnet touches a stop."""
    share: Array = process.contact(plant, gap_m).mean(axis=0)
    return share


def saturation_fraction(plant: Plant, mdp: Mdp, voltage_v: Array) -> Array:
    """Share of the plant steps with |u - u_eq| at the voltage limit or beyond."""
    v = np.abs(voltage_v - plant.equilibrium().voltage_v)
    share: Array = (v >= mdp.voltage_limit_v * (1 - 1e-9)).mean(axis=0)
    return share


def cost(plant: Plant, mdp: Mdp, response: Trajectory) -> Array:
    """Sum of the stage cost over the plant steps: minus the undiscounted return, contact penalty left out."""
    states = State(response.gap_m[:-1], response.velocity_m_s[:-1], response.current_a[:-1])
    v = response.voltage_v - plant.equilibrium().voltage_v
    total: Array = process.stage_cost(mdp, process.deviation(plant, states), v).sum(axis=0)
    return total


def response_metrics(plant: Plant, mdp: Mdp, response: Trajectory) -> dict[str, Array]:
    """All metrics of a response, each of shape [n].

    Settling time, overshoot, bias and peak voltage are those of the whole response. Cost, RMSE, contact and
    saturation are those of its first `mdp.episode_duration_s`, so that they compare with an agent's episode.
    """
    episode = response.until(mdp.episode_duration_s)
    x_eq = plant.equilibrium().gap_m
    error = response.gap_m - x_eq
    return {
        "cost": cost(plant, mdp, episode),
        "settling_time_s": settling_time_s(response.time_s, error),
        "overshoot": overshoot(error),
        "steady_state_bias_m": steady_state_bias_m(error),
        "steady_state_error_m": steady_state_error_m(error),
        "gap_rmse_m": gap_rmse_m(episode.gap_m - x_eq),
        "peak_voltage_v": peak_voltage_v(plant, response.voltage_v),
        "contact_fraction": contact_fraction(plant, episode.gap_m),
        "saturation_fraction": saturation_fraction(plant, mdp, episode.voltage_v),
    }
