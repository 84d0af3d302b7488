"""Disturbances: their size, and where the rail is smooth."""

import numpy as np
import pytest

from maglev_offline.physics.disturbance import force_noise, rail_profile


def test_force_noise_has_its_standard_deviation() -> None:
    force = force_noise(np.random.default_rng(0), (200_000,), 500.0)
    assert force.std() == pytest.approx(500, rel=0.01)
    assert not force_noise(np.random.default_rng(0), (5,), 0.0).any()


def test_rail_has_its_root_mean_square() -> None:
    rail = rail_profile(np.random.default_rng(0), np.arange(0, 20_000, 0.5), rms_m=0.001)
    assert np.sqrt(np.mean(rail**2)) == pytest.approx(0.001, rel=0.05)
