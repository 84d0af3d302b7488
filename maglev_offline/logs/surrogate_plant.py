"""The world behind the surrogate logs: runs of a loaded vehicle on an uneven rail, under PID or cascade control.

All runs of all points of a log are one batch, since each run starts at rest from a known state. Everything is drawn
run by run from streams of its own, so a shorter log is the beginning of a longer one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maglev_offline.control.feedback import IntegralFeedback
from maglev_offline.control.pid import cascade, pid
from maglev_offline.logs.surrogate_settings import ControllerKind, SurrogateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.disturbance import force_noise, rail_profile
from maglev_offline.physics.dynamics import State, step
from maglev_offline.physics.parameters import Plant
from maglev_offline.streams import stream

Array = NDArray[np.float64]

STEP_S = 1e-3
"""Period of the simulation, of the controller and of the truth."""

_STANDING_S = 3.0


@dataclass(frozen=True)
class Run:
    """One levitation: when it starts in the log, how long it was meant to be and how long it is, and its draws."""

    start_s: float
    planned_steps: int
    steps: int
    start_gap_m: Array
    from_stop: NDArray[np.bool_]
    set_point_m: Array
    set_point_step_at: int
    cruise_speed_m_s: float


@dataclass(frozen=True)
class RunTruth:
    """What happened in a run, at 1 kHz: arrays [steps, points] in SI units; speed [steps], chainage [steps, points]."""

    run: Run
    gap_m: Array
    velocity_m_s: Array
    current_a: Array
    voltage_v: Array
    set_point_m: Array
    force_n: Array
    speed_m_s: Array
    chainage_m: Array


def plan_runs(plant: Plant, mdp: Mdp, settings: SurrogateSettings, log: int) -> list[Run]:
    """The runs of a log, one after the other with a pause between; the last is cut at the end of the log."""
    runs: list[Run] = []
    now = 0.0
    while now < settings.duration_s - 1.0:
        rng = stream(settings.seed, f"surrogate/{log}/{len(runs)}/plan")
        planned = round(rng.uniform(*settings.run_s) / STEP_S)
        gaps = rng.uniform(*mdp.start_gap_m, settings.points)
        from_stop = rng.random(settings.points) < settings.from_stop_share
        step_m = rng.uniform(-1, 1, settings.points) * settings.set_point_step_m
        stepped = rng.random(settings.points) < settings.set_point_step_share
        step_at = round(rng.uniform(0.3, 0.8) * planned)
        cruise = rng.uniform(*settings.cruise_speed_m_s)
        steps = min(planned, round((settings.duration_s - now) / STEP_S))
        start = np.where(from_stop, plant.gap_max_m, gaps)
        set_point = plant.set_point_m + step_m * stepped
        runs.append(Run(now, planned, steps, start, from_stop, set_point, step_at, cruise))
        now = round(now + planned * STEP_S + settings.pause_s, 3)
    return runs


def load_kg(plant: Plant, settings: SurrogateSettings, log: int) -> float:
    """Mass that a point carries in this log, to 1/1000 of the plant's own."""
    share = 1 + stream(settings.seed, f"surrogate/{log}/load").uniform(-1, 1) * settings.load_spread
    return float(round(share, 3) * plant.mass_kg)


def speed_profile(settings: SurrogateSettings, run: Run) -> Array:
    """Speed in m/s over the planned steps: stand, accelerate, cruise, brake, stand."""
    t = np.arange(run.planned_steps) * STEP_S
    away, home = t - _STANDING_S, t[-1] - _STANDING_S - t
    slope = settings.acceleration_m_s2 * np.minimum(away, home)
    speed: Array = np.clip(slope, 0.0, run.cruise_speed_m_s)
    return speed


def controller(plant: Plant, mdp: Mdp, settings: SurrogateSettings, kind: ControllerKind) -> IntegralFeedback:
    """The controller of a log, tuned for the plant without its load's deviation."""
    if kind == "pid":
        return pid(settings.pid, mdp.voltage_limit_v)
    return cascade(plant, settings.cascade, mdp.voltage_limit_v)


def simulate_log(plant: Plant, mdp: Mdp, settings: SurrogateSettings, log: int, kind: ControllerKind) -> list[RunTruth]:
    """Simulate a log at 1 kHz with RK4.

    The equation of motion holds for the gap x = magnet - rail: an acceleration of the rail acts as a force
    -m r'' on the mass. The controller sees the true state; sensors are noisy in the record only.
    """
    runs = plan_runs(plant, mdp, settings, log)
    loaded = plant.model_copy(update={"mass_kg": load_kg(plant, settings, log)})
    disturbances, chainage_m = [], 0.0
    for number, run in enumerate(runs):
        disturbances.append(_disturbance(loaded, settings, log, number, run, chainage_m))
        chainage_m = float(disturbances[-1][1][-1, 0])
    longest = max(run.steps for run in runs)
    force = np.concatenate([_padded(d[2][: r.steps], longest) for r, d in zip(runs, disturbances, strict=True)], axis=1)
    states, voltage, set_point = _close_loop(plant, loaded, controller(plant, mdp, settings, kind), runs, force)
    truths = []
    for number, (run, (speed, chainage, _)) in enumerate(zip(runs, disturbances, strict=True)):
        mine = np.s_[: run.steps, number * settings.points : (number + 1) * settings.points]
        gap, velocity, current, u, point, f = (x[mine] for x in (*states, voltage, set_point, force))
        driven = (speed[: run.steps], chainage[: run.steps])
        truths.append(RunTruth(run, gap, velocity, current, u, point, f, *driven))
    return truths


def _padded(rows: Array, length: int) -> Array:
    return np.pad(rows, ((0, length - len(rows)), (0, 0)))


def _disturbance(
    loaded: Plant, settings: SurrogateSettings, log: int, number: int, run: Run, chainage_m: float
) -> tuple[Array, Array, Array]:
    """Speed [steps], chainage and force [steps, points] of a planned run that starts at `chainage_m`."""
    speed = speed_profile(settings, run)
    chainage = (chainage_m + np.cumsum(speed) * STEP_S)[:, None] - settings.point_spacing_m * np.arange(settings.points)
    if number == 0:
        chainage = chainage + settings.point_spacing_m * (settings.points - 1)
    rail = rail_profile(stream(settings.seed, f"surrogate/{log}/rail"), chainage, rms_m=settings.rail_rms_m)
    rail_acceleration = np.gradient(np.gradient(rail, STEP_S, axis=0), STEP_S, axis=0)
    rng = stream(settings.seed, f"surrogate/{log}/{number}/force")
    force = force_noise(rng, chainage.shape, settings.force_noise_std_n) - loaded.mass_kg * rail_acceleration
    return speed, chainage, force


def _close_loop(
    plant: Plant, loaded: Plant, law: IntegralFeedback, runs: list[Run], force_n: Array
) -> tuple[Array, Array, Array]:
    """States [3, steps, runs x points], total voltage and set-point [steps, runs x points] under the law."""
    gap = np.concatenate([run.start_gap_m for run in runs])
    from_stop = np.concatenate([run.from_stop for run in runs])
    later = np.concatenate([run.set_point_m for run in runs])
    step_at = np.concatenate([np.full(run.set_point_m.shape, run.set_point_step_at) for run in runs])
    state = State(gap, np.zeros_like(gap), np.where(from_stop, 0.0, plant.equilibrium().current_a))
    states, voltage = np.empty((3, *force_n.shape)), np.empty(force_n.shape)
    set_point = np.where(np.arange(len(force_n))[:, None] >= step_at, later, plant.set_point_m)
    rest_a = np.sqrt(plant.kappa) * (set_point + plant.pole_offset_m)
    rest_v = plant.resistance_ohm * rest_a
    z = np.zeros((*gap.shape, 3))
    memory = law.start(z)
    for k, force in enumerate(force_n):
        z[:, 0], z[:, 1], z[:, 2] = state.gap_m - set_point[k], state.velocity_m_s, state.current_a - rest_a[k]
        v, memory = law.control(z, memory, STEP_S)
        states[:, k], voltage[k] = state, rest_v[k] + v
        state = step(loaded, state, voltage[k], STEP_S, force_n=force, integrator="rk4")
    return states, voltage, set_point
