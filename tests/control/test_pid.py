"""The paper's PID (Sec. VI-A) as measured, and the cascade."""

import numpy as np
import pytest

from maglev_offline.control.feedback import closed_loop_poles, is_stable
from maglev_offline.control.metrics import overshoot, settling_time_s
from maglev_offline.control.pid import CascadeGains, PidGains, cascade, pid
from maglev_offline.control.simulate import PlantKind, regulate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.dynamics import Integrator
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

PLANT = Plant()


@pytest.mark.parametrize(("euler_step_s", "lowest", "highest"), [(None, 2545, 3517), (0.001, 2545, 3226)])
def test_stable_range_of_kp(euler_step_s: float | None, lowest: int, highest: int) -> None:
    """By hand (Routh, Ki = 0): a r < b Kp < a r + r b Kd, a = 2 g / x_eq, r = R / L, b = -A[1, 2] / L."""
    linear = linearise(PLANT)

    def stable(kp: int) -> bool:
        gain = pid(PidGains(kp=kp)).gain
        return is_stable(closed_loop_poles(linear, gain), euler_step_s)

    found = [kp for kp in range(2400, 3900) if stable(kp)]
    assert found == list(range(found[0], found[-1] + 1))
    assert (found[0], found[-1]) == (lowest, highest)


@pytest.mark.parametrize(
    ("kind", "integrator", "step_ms", "gap_max_m", "settles_s", "beyond"),
    [
        ("nonlinear", "rk4", 1.0, 0.016, 6.2, 0.276),
        ("linear", "euler", 1.0, 0.016, 23.8, 2.36),
        ("linear", "rk4", 0.1, 0.016, 7.6, 1.42),
    ],
)
def test_response_from_15_mm(
    kind: PlantKind, integrator: Integrator, step_ms: float, gap_max_m: float, settles_s: float, beyond: float
) -> None:
    plant = Plant(gap_max_m=gap_max_m)
    mdp = Mdp(plant_step_ms=step_ms, integrator=integrator)
    duration = 25.0 if integrator == "euler" else 10.0
    start = np.array([0.015])
    response = regulate(plant, mdp, pid(PidGains()), start, duration, plant_kind=kind, limited=kind == "nonlinear")
    error = response.gap_m - plant.set_point_m
    assert settling_time_s(response.time_s, error)[0] == pytest.approx(settles_s, abs=0.05)
    assert overshoot(error)[0] == pytest.approx(beyond, abs=0.005)


def test_cascade_is_well_damped_on_any_plant(any_plant: Plant) -> None:
    poles = closed_loop_poles(linearise(any_plant), cascade(any_plant, CascadeGains()).gain)
    assert is_stable(poles)
    assert is_stable(poles, 0.001)
    assert np.all(-poles.real / np.abs(poles) > 0.7)


def test_cascade_settles_and_removes_a_load() -> None:
    mdp = Mdp()
    law = cascade(PLANT, CascadeGains(), mdp.voltage_limit_v)
    response = regulate(PLANT, mdp, law, np.array([0.015]), 1.0)
    assert settling_time_s(response.time_s, response.gap_m - 0.008)[0] < 0.2
    loaded = regulate(PLANT, mdp, law, np.array([0.008]), 15.0, force_n=np.full((15_000, 1), 500.0))
    assert np.abs(loaded.gap_m - 0.008).max() > 1e-4
    assert abs(loaded.gap_m[-1, 0] - 0.008) < 1e-5
