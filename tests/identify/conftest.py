from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest

from maglev_offline.control.lqi import LqiWeights, lqi
from maglev_offline.control.simulate import regulate
from maglev_offline.mdp import Mdp


@dataclass(frozen=True)
class Excited:
    """A law whose set-point moves: sines and steps of `reach` metres, other ones for each magnet of the batch."""

    law: object
    reach: float
    back: float

    def start(self, z):
        return self.law.start(z), 0.0

    def control(self, z, memory, dt_s):
        inner, t = memory
        n = np.arange(z.shape[0])
        moved = self.reach * (
            0.45 * np.sin(2 * np.pi * (1.3 + 0.4 * n) * t + n)
            + 0.2 * np.sin(2 * np.pi * (4.1 + 0.3 * n) * t)
            + 0.35 * np.sign(np.sin(2 * np.pi * (0.31 + 0.1 * n) * t + 1 + n))
        )
        target = np.stack([moved, 0 * moved, self.back * moved], axis=-1)
        v, inner = self.law.control(z - target, inner, dt_s)
        return v, (inner, t + dt_s)


def frame_of(run, every, plant, *, noise=0.0):
    """Samples of a trajectory, each `every`-th plant step; `noise`: share of the signals' own spread."""
    rng = np.random.default_rng(7)
    parts = []
    for k in range(run.gap_m.shape[1]):
        rows = np.arange(0, len(run.voltage_v), every)
        signals = {
            "gap_m": run.gap_m[rows, k],
            "current_a": run.current_a[rows, k],
            "voltage_v": run.voltage_v[rows, k],
        }
        for name, values in signals.items():
            signals[name] = values + noise * values.std() * rng.standard_normal(len(values))
        touching = (run.gap_m[rows, k] <= plant.gap_min_m) | (run.gap_m[rows, k] >= plant.gap_max_m)
        t = pd.to_datetime(np.round(run.time_s[rows] * 1e9).astype(np.int64), utc=True)
        parts.append(
            pd.DataFrame(
                {
                    **{"log_id": f"log{k}", "point": "P1", "t": t, "segment": 0, "step": np.arange(len(rows))},
                    **signals,
                    "contact": touching,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def excited_run(plant, *, hold_ms=1.0, seconds=8.0, magnets=4, reach=None):
    """Magnets that follow a moving set-point, Runge-Kutta at a quarter of the period for which the voltage is held."""
    train = plant.mass_kg > 1
    mdp = Mdp(plant_step_ms=min(1.0, hold_ms / 4), voltage_limit_v=400 if train else 40, integrator="rk4")
    weights = LqiWeights() if train else LqiWeights(gap_per_m2=1e7, velocity_s2_per_m2=1e4, integral_per_m2_s2=1e4)
    if train:
        weights = LqiWeights(gap_per_m2=3e9, velocity_s2_per_m2=1e6)
    law = lqi(plant, weights)
    back = np.sqrt(plant.kappa)
    reach = 0.25 * plant.set_point_m if reach is None else reach
    starts = np.full(magnets, plant.set_point_m)
    return regulate(plant, mdp, Excited(law, reach, back), starts, seconds, control_period_s=hold_ms / 1e3)


@pytest.fixture(scope="session")
def simulate():
    """Samples of a plant in closed loop under a moving set-point, one log for each magnet."""
    cache = {}

    def simulate(plant, period_ms=10.0, *, noise=0.0, reach=None, seconds=8.0, magnets=4, hold_ms=None):
        hold = hold_ms or min(period_ms, 2.0)
        key = (plant.model_dump_json(), hold, reach, seconds, magnets)
        if key not in cache:
            cache[key] = excited_run(plant, hold_ms=hold, reach=reach, seconds=seconds, magnets=magnets)
        run = cache[key]
        every = round(period_ms / 1e3 / (run.time_s[1] - run.time_s[0]))
        return frame_of(run, every, plant, noise=noise)

    return simulate
