"""Logs of the surrogate at 100 ms as sensors see them, and the truth beside them."""

import numpy as np
import pytest

from maglev_offline.mdp import deviation
from maglev_offline.physics.dynamics import State
from maglev_offline.physics.parameters import Plant

PLANT = Plant()
NOISE = {"gap_m": 1e-5, "current_a": 0.02, "voltage_v": 0.1}


@pytest.fixture(scope="package")
def logged(samples_every):
    """Noisy samples without a velocity: what stands in its place are differences of the gap."""
    samples, rng = samples_every(100), np.random.default_rng(4)
    for name, std in NOISE.items():
        samples[name] += rng.normal(0, std, len(samples))
    gap = samples.groupby(["point", "segment"])["gap_m"]
    samples["gap_velocity_m_s"] = ((gap.shift(-1) - gap.shift(1)) / 0.2).fillna(0.0)
    return samples.assign(gap_velocity_origin="reconstructed")


@pytest.fixture(scope="package")
def true_states(samples_every):
    """Deviation [n, 3] from the plant's equilibrium of the 1 kHz truth when each row of a table begins."""
    truth, key = samples_every(1), ["point", "segment", "t"]

    def find(table, plant=PLANT):
        found = table[key].merge(truth, on=key, how="left")
        began = table[["point", "segment"]].assign(step=table["step"] * 100)
        own = began.merge(truth, on=["point", "segment", "step"], how="left")
        at = own["set_point_m"].to_numpy()  # a row keeps the set-point of its pair
        return deviation(plant, State(*(found[n].to_numpy() for n in ("gap_m", "gap_velocity_m_s", "current_a"))), at)

    return find
