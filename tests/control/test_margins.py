"""Margins against computations of another kind: eigenvalues of scaled gains, delays by Pade, Routh by hand."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import cont2discrete

from maglev_offline.control.feedback import augmented, closed_loop_poles, is_stable
from maglev_offline.control.margins import (
    Sampling,
    loop_is_stable,
    loop_margins,
    margins_of_all,
    open_loop,
    root_locus,
    stable_kp_range,
)
from maglev_offline.control.pid import PidGains, pid
from maglev_offline.control.reference import feedback_laws
from maglev_offline.control.settings import ControlSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

PLANT = Plant()
LINEAR = linearise(PLANT)
NAMES = ("pid", "cascade", "lqr", "lqi")


def law(plant: Plant, name: str) -> np.ndarray:
    return feedback_laws(plant, Mdp(), ControlSettings(), None)[name].gain  # type: ignore[index]


def stable_with_delay(plant: Plant, gain: np.ndarray, delay_s: float) -> bool:
    """Poles of the loop with a Pade delay of sixth order in front of the plant."""
    import control

    a, b = augmented(linearise(plant))
    if gain[3] == 0:
        a, b, gain = a[:3, :3], b[:3], gain[:3]
    late = control.ss(*control.ssdata(control.tf2ss(*control.pade(delay_s, 6))))
    whole = control.ss(a, b, np.eye(len(a)), np.zeros((len(a), 1))) * late
    closed = whole.A + whole.B @ np.linalg.solve(1 - gain[None, :] @ whole.D, gain[None, :] @ whole.C)
    return bool(np.linalg.eigvals(closed).real.max() < 0)


def test_the_paper_s_pid() -> None:
    found = loop_margins(LINEAR, pid(PidGains()).gain)
    assert found.verdict == "stable"
    assert found.phase_margin_deg == pytest.approx(2.5, abs=0.05)
    assert found.delay_margin_s == pytest.approx(1.4e-3, abs=0.05e-3)
    assert found.crossover_rad_s == pytest.approx(30.4, abs=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_open_loop_is_the_state_space_s(any_plant: Plant, name: str) -> None:
    linear, gain = linearise(any_plant), law(any_plant, name)
    a, b = augmented(linear)
    loop = open_loop(linear, gain)
    for s in (3j, 40j, 900j):
        expected = -(gain @ np.linalg.solve(s * np.eye(4) - a, b))[0]
        assert complex(loop(s)) == pytest.approx(expected, rel=1e-9)


def test_open_loop_of_the_pid_is_minus_the_controller_times_the_plant() -> None:
    s = 25j
    plant = (LINEAR.c @ np.linalg.solve(s * np.eye(3) - LINEAR.a, LINEAR.b))[0, 0]
    loop = open_loop(LINEAR, pid(PidGains()).gain)
    assert complex(loop(s)) == pytest.approx(-(3100 + 310 * s + 300 / s) * plant, rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_gain_margins_are_where_the_poles_cross(any_plant: Plant, name: str) -> None:
    linear, gain = linearise(any_plant), law(any_plant, name)
    found = loop_margins(linear, gain)
    down, up = found.gain_margin_down, found.gain_margin_up
    assert 0 < down < 1 < up
    inside = np.geomspace(down * 1.001, min(up * 0.999, 1e3), 50)
    assert all(is_stable(closed_loop_poles(linear, factor * gain)) for factor in inside)
    assert not is_stable(closed_loop_poles(linear, down * 0.999 * gain))
    assert np.isinf(up) or not is_stable(closed_loop_poles(linear, up * 1.001 * gain))


@pytest.mark.parametrize("name", NAMES)
def test_the_delay_margin_is_where_a_delay_destabilises(any_plant: Plant, name: str) -> None:
    gain = law(any_plant, name)
    margin = loop_margins(linearise(any_plant), gain).delay_margin_s
    assert stable_with_delay(any_plant, gain, 0.99 * margin)
    assert not stable_with_delay(any_plant, gain, 1.01 * margin)


@pytest.mark.parametrize("name", NAMES)
def test_the_phase_margin_by_a_sweep_over_frequency(any_plant: Plant, name: str) -> None:
    linear, gain = linearise(any_plant), law(any_plant, name)
    found = loop_margins(linear, gain)
    w = np.geomspace(0.1, 1e5, 200_001)
    value = open_loop(linear, gain)(1j * w)
    crossed = np.flatnonzero(np.diff(np.sign(np.abs(value) - 1)))
    assert np.rad2deg(np.abs(np.angle(-value[crossed])).min()) == pytest.approx(found.phase_margin_deg, abs=0.02)
    assert np.min(np.abs(w[crossed] / found.crossover_rad_s - 1)) < 1e-3


def test_margins_of_all_controllers() -> None:
    found = margins_of_all(PLANT, Mdp(), ControlSettings())
    assert set(found) == {*NAMES, "lqr_held"}
    assert all(found[name].phase_margin_deg > 60 for name in ("cascade", "lqr", "lqi"))
    assert all(found[name].gain_margin_down < 0.5 and np.isinf(found[name].gain_margin_up) for name in ("lqr", "lqi"))


@pytest.mark.parametrize(
    "gain", [[0.0] * 4, [100.0, 310.0, 0, 300], [-3100.0, -310, 0, -300], [np.nan] * 4, [np.inf, 1, 0, 0]]
)
def test_unstable_as_given(gain: list[float]) -> None:
    found = loop_margins(LINEAR, np.array(gain))
    assert found.verdict == "unstable as given"
    assert np.isnan([found.gain_margin_up, found.phase_margin_deg, found.delay_margin_s]).all()


def test_a_recipe_with_unstable_gains_is_told_and_does_not_crash() -> None:
    settings = ControlSettings(pid=PidGains(kp=100))
    found = margins_of_all(PLANT, Mdp(), settings)
    assert [name for name, margins in found.items() if not margins.stable] == ["pid"]


@pytest.mark.parametrize(
    ("sampling", "lowest", "highest"), [("continuous", 2545, 3517), ("euler", 2545, 3226), ("zoh", 2545, 3368)]
)
def test_range_of_kp(sampling: Sampling, lowest: int, highest: int) -> None:
    found = stable_kp_range(PLANT, PidGains(), sampling)
    assert found is not None
    assert (np.ceil(found.lowest), np.floor(found.highest)) == (lowest, highest)
    assert found.step_s == (None if sampling == "continuous" else 1e-3)


@pytest.mark.parametrize("sampling", ["continuous", "euler", "zoh"])
@pytest.mark.parametrize("ki", [0.0, 300.0, 5e3])
def test_edges_of_the_range_by_eigenvalues(any_plant: Plant, sampling: Sampling, ki: float) -> None:
    """On other loops too, and sampled by scipy instead of the module."""
    linear, kd = linearise(any_plant), 310.0 if any_plant == PLANT else 20.0
    step_s = 1e-3 if any_plant == PLANT else 1e-5
    found = stable_kp_range(any_plant, PidGains(kd=kd, ki=ki), sampling, step_s)
    assert found is not None

    def stable(kp: float) -> bool:
        gain = np.array([kp, kd, 0.0, ki])
        if sampling != "zoh":
            return is_stable(closed_loop_poles(linear, gain), step_s if sampling == "euler" else None)
        a, b, *_ = cont2discrete((linear.a, linear.b, np.eye(3), np.zeros((3, 1))), step_s)
        size = 4 if ki else 3
        whole, driven = np.eye(4), np.append(b, 0.0)
        whole[:3, :3], whole[3, 0] = a, step_s
        closed = whole + np.outer(driven, gain)
        return bool(np.abs(np.linalg.eigvals(closed[:size, :size])).max() < 1)

    width = found.highest - found.lowest
    assert all(stable(kp) for kp in np.linspace(found.lowest + 1e-4 * width, found.highest - 1e-4 * width, 30))
    assert not stable(found.lowest - 1e-4 * width)
    assert not stable(found.highest + 1e-4 * width)


@pytest.mark.parametrize("sampling", ["continuous", "euler", "zoh"])
@pytest.mark.parametrize("gains", [PidGains(kd=0), PidGains(ki=1e9), PidGains(ki=-1)])
def test_no_kp_is_stable(gains: PidGains, sampling: Sampling) -> None:
    assert stable_kp_range(PLANT, gains, sampling) is None
    tried = np.linspace(-1e4, 1e4, 401)
    assert not any(loop_is_stable(LINEAR, np.array([kp, gains.kd, 0.0, gains.ki]), sampling, 1e-3) for kp in tried)


def test_a_step_too_long_leaves_no_kp() -> None:
    assert stable_kp_range(PLANT, PidGains(), "zoh", 0.05) is None
    assert not loop_is_stable(LINEAR, pid(PidGains()).gain, "zoh", 0.05)


@pytest.mark.parametrize("ki", [0.0, 300.0])
def test_root_locus_holds_the_closed_loop_poles(ki: float) -> None:
    gains = PidGains(ki=ki)
    locus = root_locus(PLANT, gains, np.array([0.0, 2600.0, 3100.0, 5000.0]))
    assert locus.poles_rad_s.shape == (4, 4 if ki else 3)
    for kp, poles in zip(locus.kp, locus.poles_rad_s, strict=True):
        expected = closed_loop_poles(LINEAR, np.array([kp, gains.kd, 0.0, ki]))
        np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(expected), atol=1e-5)


def test_root_locus_by_default_shows_both_edges_of_stability() -> None:
    locus = root_locus(PLANT, PidGains())
    stable = locus.kp[locus.poles_rad_s.real.max(axis=1) < 0]
    assert locus.kp[0] == 0
    assert locus.kp[-1] > 1.4 * stable[-1]
    assert (stable[0], stable[-1]) == pytest.approx((2545, 3517), abs=15)


def test_nothing_heavy_is_imported_with_the_modules() -> None:
    code = (
        "import sys, maglev_offline.control.claims, maglev_offline.control.margins\n"
        "print(sorted({'torch', 'matplotlib', 'control'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
