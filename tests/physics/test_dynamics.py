"""Nonlinear dynamics: force, order of the integrators, stops, and numpy against torch."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.physics.dynamics import (
    FEW,
    Integrator,
    State,
    derivative,
    in_contact,
    inductance,
    step,
    suspension_force,
)
from maglev_offline.physics.parameters import Plant

PLANT = Plant()


def a_state(rows: int = 5) -> State:
    rng = np.random.default_rng(0)
    return State(rng.uniform(0.004, 0.012, rows), rng.normal(0, 0.1, rows), rng.uniform(10, 25, rows))


def test_magnet_carries_mass_at_equilibrium() -> None:
    gap, current, voltage = PLANT.equilibrium()
    assert suspension_force(PLANT, gap, current) == pytest.approx(700 * 9.8)
    np.testing.assert_allclose(derivative(PLANT, State(gap, 0.0, current), voltage), 0.0, atol=1e-12)


def test_coil_time_constant() -> None:
    assert inductance(PLANT, 0.008) / 1.2 == pytest.approx(0.318, abs=5e-4)


def test_paper_equations_in_deviations() -> None:
    """Sec. II-B as printed, against the absolute form that the code uses."""
    state, x_eq, k, m, g, r = a_state(), 0.008, PLANT.kappa, 700, 9.8, 1.2
    _, i_eq, u_eq = PLANT.equilibrium()
    z1, z2, z3, v, f = state.gap_m - x_eq, state.velocity_m_s, state.current_a - i_eq, 15.0, 300.0
    dz2 = ((2 * x_eq + z1) * z1 * g) / (z1 + x_eq) ** 2
    dz2 -= ((2 * np.sqrt(k) * x_eq + z3) * z3 * g) / (k * (z1 + x_eq) ** 2)
    dz3 = (z3 + np.sqrt(k) * x_eq) / (z1 + x_eq) * z2 + k * (z1 + x_eq) / (2 * m * g) * (v - z3 * r)
    rate = derivative(PLANT, state, u_eq + v, f)
    np.testing.assert_allclose(rate.velocity_m_s, dz2 + f / m, rtol=1e-10)
    np.testing.assert_allclose(rate.current_a, dz3, rtol=1e-10)


def test_energy_is_conserved() -> None:
    """Power of the source = heat + rate of magnetic, kinetic and (falling) potential energy."""
    state, u, h = a_state(), 30.0, 1e-7
    rate = derivative(PLANT, state, u)

    def energy(s: State) -> np.ndarray:
        magnetic = inductance(PLANT, s.gap_m) * s.current_a**2 / 2
        return magnetic + PLANT.mass_kg * (s.velocity_m_s**2 / 2 - PLANT.gravity_m_s2 * s.gap_m)

    ahead, behind = (State(*(x + w * dx for x, dx in zip(state, rate, strict=True))) for w in (h, -h))
    power = (energy(ahead) - energy(behind)) / (2 * h)
    np.testing.assert_allclose(power, u * state.current_a - PLANT.resistance_ohm * state.current_a**2, rtol=1e-5)


@pytest.mark.parametrize(("integrator", "order"), [("euler", 1), ("rk4", 4)])
def test_order_of_convergence(integrator: Integrator, order: int) -> None:
    def end(steps: int) -> np.ndarray:
        state = State(np.array([0.009]), np.array([0.02]), np.array([19.0]))
        for _ in range(steps):
            state = step(PLANT, state, np.array([25.0]), 0.04 / steps, integrator=integrator)
        return np.array(state).ravel()

    coarse, fine, finest = end(20), end(40), end(80)
    ratio = np.abs(coarse - fine).max() / np.abs(fine - finest).max()
    assert np.log2(ratio) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
def test_numpy_equals_torch(integrator: Integrator) -> None:
    state, volts = a_state(), np.linspace(-150, 220, 5)
    tensors = State(*(torch.from_numpy(x) for x in state))
    for _ in range(30):
        state = step(PLANT, state, volts, 1e-3, integrator=integrator)
        tensors = step(PLANT, tensors, torch.from_numpy(volts), 1e-3, integrator=integrator)
    for ours, theirs in zip(state, tensors, strict=True):
        np.testing.assert_allclose(ours, theirs.numpy(), rtol=1e-12)


def test_stops_hold_and_take_the_velocity() -> None:
    falling = State(np.array([0.01599]), np.array([0.5]), np.array([0.0]))
    landed = step(PLANT, falling, np.array([0.0]), 1e-3)
    assert landed.gap_m[0] == PLANT.gap_max_m
    assert in_contact(PLANT, landed.gap_m)[0]
    rested = step(PLANT, landed, np.array([0.0]), 1e-3)
    assert rested.velocity_m_s[0] <= PLANT.gravity_m_s2 * 1e-3
    assert rested.gap_m[0] == PLANT.gap_max_m
    lifted = step(PLANT, State(np.array([0.0155]), np.array([-0.1]), np.array([45.0])), np.array([60.0]), 1e-3)
    assert not in_contact(PLANT, lifted.gap_m)[0]


def test_current_does_not_turn_round() -> None:
    state = State(np.array([0.008]), np.array([0.0]), np.array([0.1]))
    assert step(PLANT, state, np.array([-200.0]), 1e-3).current_a[0] == 0.0


@settings(max_examples=20, deadline=None)
@given(
    st.integers(1, FEW),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["number", "one", "each"]),
    st.sampled_from([700.0, [700.0]]),
)
def test_a_magnet_moves_to_the_same_bits_alone_and_in_a_batch(n: int, seed: int, force: str, mass: object) -> None:
    """Few magnets are advanced as floats, many as arrays; stops and a current of 0 are met on the way."""
    rng, many = np.random.default_rng(seed), FEW + 1
    few = State(rng.uniform(0.0005, 0.016, n), rng.normal(0, 0.5, n), rng.uniform(0, 40, n))
    batch = State(*(np.resize(field, many) for field in few))
    plant = PLANT.model_copy(update={"mass_kg": np.array(mass) if isinstance(mass, list) else mass})
    for _ in range(10):
        volts, f = rng.uniform(-300, 300, n), rng.normal(0, 3000, n)
        acting = {"number": f[0], "one": f[:1], "each": f}[force]
        acts = np.resize(acting, many) if force == "each" else acting
        few = step(plant, few, volts, 1e-3, force_n=acting, integrator="rk4")
        batch = step(plant, batch, np.resize(volts, many), 1e-3, force_n=acts, integrator="rk4")
        for alone, among in zip(few, batch, strict=True):
            assert alone.shape == (n,)
            np.testing.assert_array_equal(alone, among[:n])


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
def test_floats_move_as_arrays_do(integrator: Integrator) -> None:
    state = a_state(FEW + 1)
    moved = step(PLANT, state, 20.0, 1e-3, force_n=100.0, integrator=integrator)
    for k, magnet in enumerate(zip(*(field.tolist() for field in state), strict=True)):
        alone = step(PLANT, State(*magnet), 20.0, 1e-3, force_n=100.0, integrator=integrator)
        assert alone == tuple(field[k] for field in moved)


def test_a_lone_magnet_that_is_no_number_stays_none() -> None:
    lost = State(*np.full((3, 1), np.nan))
    assert np.isnan(step(PLANT, lost, np.array([20.0]), 1e-3, integrator="rk4")).all()
