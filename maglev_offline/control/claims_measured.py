"""What this code measures for each statement of the paper, on the paper's plant, whatever the recipe."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.control.claim import Claim, percent, row, say, seconds
from maglev_offline.control.feedback import IntegralFeedback, closed_loop_poles
from maglev_offline.control.lqi import LqiWeights, lqi, lqr_for_mdp
from maglev_offline.control.margins import SAMPLINGS, loop_margins, stable_kp_range
from maglev_offline.control.metrics import contact_fraction, cost, overshoot, peak_voltage_v, settling_time_s
from maglev_offline.control.observer import ObserverFeedback, ObserverSettings
from maglev_offline.control.pid import PidGains, pid
from maglev_offline.control.simulate import Trajectory, regulate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.disturbance import force_noise
from maglev_offline.physics.dynamics import State, step, suspension_force
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

PAPER = Plant(coil_turns=450, pole_area_m2=0.024)
OPEN = PAPER.model_copy(update={"gap_max_m": 0.03})
MDP = Mdp()
START = np.array([0.015])
TEN_STARTS = np.linspace(0.004, 0.015, 10)
DRAWS = 16
STOPS = f"stops {1e3 * PAPER.gap_min_m:g} and {1e3 * PAPER.gap_max_m:g} mm"
NONLINEAR = f"nonlinear, {MDP.voltage_limit_v:g} V, {STOPS}"
EULER = f"{NONLINEAR}, Euler 1 ms"


def _near(target: float, share: float, *values: Any) -> bool:
    """Whether all values are within `share` of the target; NaN is not."""
    return all(abs(float(x) - target) <= share * target for x in values)


def _response(controller: Any, duration_s: float, plant: Plant = PAPER, mdp: Mdp = MDP, **how: Any) -> Trajectory:
    """From 15 mm unless told otherwise; the linear plant has no voltage limit."""
    how = {"start_gap_m": START, "limited": how.get("plant_kind") != "linear"} | how
    return regulate(plant, mdp, controller, duration_s=duration_s, **how)


def _settles(response: Trajectory) -> Array:
    return settling_time_s(response.time_s, response.gap_m - PAPER.set_point_m)


def _overshoots(response: Trajectory) -> Array:
    return overshoot(response.gap_m - PAPER.set_point_m)


def _model() -> list[Claim]:
    linear, (gap, current, volt) = linearise(PAPER), PAPER.equilibrium()
    exact, printed = (
        float(suspension_force(PAPER, gap, i)) / (PAPER.mass_kg * PAPER.gravity_m_s2) - 1 for i in (current, 17.0)
    )
    entries = np.array([*linear.a[1, [0, 2]], *linear.a[2, 1:], linear.b[2, 0]])
    off = np.abs(entries - [2450, -1.1558, 2119.7, -3.1438, 2.6198]) / [1, 1e-4, 0.1, 1e-4, 1e-4]
    powers = [np.linalg.matrix_power(linear.a, k) for k in range(3)]
    both = np.hstack([p @ linear.b for p in powers]), np.vstack([linear.c @ p for p in powers]).T
    ranks = [int(np.linalg.matrix_rank(m / np.linalg.norm(m, axis=0))) for m in both]
    pole, pair = linear.poles[:2]
    force = f"kappa {say(PAPER.kappa)} A2/m2; {percent(exact)} off the weight, {percent(printed)} with 17.0 A"
    digits = (
        f"{', '.join(map(say, entries[:4]))}; {say(entries[4])}: within {say(off.max(), 1)} units of the last digit"
    )
    amperes = f"{current:.1f} A (17 less {say(17 - current, 2)} A), voltage {say(volt)} V"
    c = linear.c[0].astype(int).tolist()
    return [
        row("kappa", force, "m 700 kg, N 450, A 0.024 m2, R 1.2 ohm, x_eq 8 mm, g 9.8 m/s2", abs(exact) < 1e-6),
        row("current", amperes, "sqrt(kappa) x_eq", abs(current - 17) <= 0.05),
        row("matrices", digits, "Jacobian at the set-point", np.all(off <= 0.5)),
        row("output", str(c), "the gap is measured", c == [1, 0, 0]),
        row("rank", f"rank {ranks[0]} and {ranks[1]}", "linear, columns scaled to length 1", ranks == [3, 3]),
        row("poles", f"{say(pole.real)}, {say(pair.real)} +- {say(pair.imag)}j rad/s", "linear", pole.real > 0),
    ]


def _control_period() -> list[Claim]:
    periods, once = (1, 5, 9, 10, 20, 30), Mdp(control_period_ms=1)
    setting = f"{EULER}, ten starts 4 to 15 mm, 1.8 s, LQR made for"
    rows = []
    for name in ("the period", "1 ms"):
        kept = []
        for ms in periods:
            mdp = Mdp(control_period_ms=ms, episode_duration_s=1.8) if name == "the period" else once
            law = lqr_for_mdp(PAPER, mdp, mdp.voltage_limit_v)
            response = _response(law, 1.8, start_gap_m=TEN_STARTS, control_period_s=ms / 1e3)
            if not np.isnan(_settles(response)).any():
                kept.append(ms)
        text = f"settles from all starts at {', '.join(map(str, kept))} of {', '.join(map(str, periods))} ms"
        rows.append(row("period", text, f"{setting} {name}", {ms for ms in periods if ms < 10} <= set(kept)))
    return rows


def _pid_linear() -> list[Claim]:
    linear, gains = linearise(PAPER), PidGains()
    gain = pid(gains).gain
    m = loop_margins(linear, gain)
    delay_ms, factors = say(1e3 * m.delay_margin_s, 2), f"{say(m.gain_margin_down)} to {say(m.gain_margin_up)}"
    text = f"phase {say(m.phase_margin_deg, 2)} degrees, delay {delay_ms} ms, gain x {factors}"
    rows = [row("margins", text, "linear, continuous, loop broken at the plant input")]
    for name, sampling in zip(("continuous", "Euler 1 ms", "voltage held for 1 ms, exact"), SAMPLINGS, strict=True):
        found = stable_kp_range(PAPER, gains, sampling, MDP.plant_step_s)
        # Whole gains may stand in full: machines differ in the tenth digit of an edge, not in which gains it encloses.
        text = f"whole Kp {np.ceil(found.lowest):.0f} to {np.floor(found.highest):.0f}" if found else "no Kp"
        rows.append(row("kp", text, f"linear, {name}", found is not None and found.lowest < gains.kp < found.highest))
    pole = closed_loop_poles(linear, -gain)[0].real
    text = f"a pole at {say(pole)} rad/s; u = Kp z1 + Kd z2 + Ki integral(z1) is meant"
    return [*rows, row("sign", text, "linear, continuous, gains positive as printed", pole < 0)]


def _pid_responses() -> list[Claim]:
    law, fine, rk4 = pid(PidGains()), Mdp(plant_step_ms=0.1, integrator="rk4"), Mdp(integrator="rk4")
    skid = PAPER.model_copy(update={"gap_max_m": 0.015})
    responses = {
        "linear, exact, 0.1 ms": _response(law, 9.0, mdp=fine, plant_kind="linear"),
        "linear, Euler 1 ms": _response(law, 25.0, plant_kind="linear"),
        f"{NONLINEAR}, RK4 1 ms": _response(law, 10.0, mdp=rk4),
        EULER: _response(law, 10.0),
        "nonlinear, 200 V, skid at 15 mm, RK4 0.1 ms": _response(law, 7.0, skid, fine),
    }
    rows = []
    for setting, response in responses.items():
        time_s, beyond = _settles(response)[0], _overshoots(response)[0]
        rows.append(row("PID settles", seconds(time_s), setting, _near(5.0, 0.1, time_s)))
        rows.append(row("PID overshoots", percent(beyond), setting, _near(0.25, 0.1, beyond)))
    return rows


def _noise() -> list[Claim]:
    laws = {"PID": pid(PidGains()), "LQI": lqi(PAPER, LqiWeights(), MDP.voltage_limit_v)}
    gains, limits = np.array([law.gain for law in laws.values()]), np.array([np.inf, MDP.voltage_limit_v])
    both = IntegralFeedback(np.repeat(gains, DRAWS, axis=0), np.repeat(limits, DRAWS))

    def shaken(std_n: float, start_m: float, duration_s: float) -> Trajectory:
        force = force_noise(np.random.default_rng(0), (round(duration_s / MDP.plant_step_s), DRAWS), std_n)
        start = np.full(2 * DRAWS, start_m)
        return _response(both, duration_s, start_gap_m=start, force_n=np.hstack([force, force]))

    calm, wild = shaken(500.0, START[0], 10.0), shaken(2.5e5, PAPER.set_point_m, 0.5)
    calm_rows, wild_rows = [], []
    for k, name in enumerate(laws):
        mine = np.s_[k * DRAWS : (k + 1) * DRAWS]
        settled, touched = ~np.isnan(_settles(calm)[mine]), contact_fraction(PAPER, wild.gap_m[:, mine])
        rms_mm = 1e3 * np.sqrt(np.mean((calm.gap_m[-2000:, mine] - PAPER.set_point_m) ** 2))
        text = f"{settled.sum()} of {DRAWS} draws settle; rms error in the last 2 s {say(rms_mm, 2)} mm"
        calm_rows.append(row(f"{name} calm", text, f"{EULER}, force redrawn each 1 ms, 10 s", settled.all()))
        share = percent(round(float(touched.mean()), 2))
        text = f"{(touched > 0).sum()} of {DRAWS} draws hit a stop; in contact {share} of the time"
        setting = f"{EULER}, force redrawn each 1 ms, 0.5 s from the set-point"
        wild_rows.append(row(f"{name} wild", text, setting, not touched.any()))
    return [*calm_rows, *wild_rows]


def _lqi_responses() -> list[Claim]:
    both, law, free = (Mdp(integrator="rk4"), MDP), lqi(PAPER, LqiWeights(), MDP.voltage_limit_v), "no stop at 16 mm"
    seen = ObserverFeedback(PAPER, law, ObserverSettings())
    linear = _response(lqi(PAPER, LqiWeights()), 1.0, mdp=both[0], plant_kind="linear")
    nonlinear = {
        ("LQI settles", free): [_response(law, 1.0, OPEN, mdp) for mdp in both],
        ("LQI settles", STOPS): [_response(law, 1.0, PAPER, mdp) for mdp in both],
        ("filter", STOPS): [_response(seen, 1.0, PAPER, mdp) for mdp in both],
    }
    pole = closed_loop_poles(linearise(PAPER), law.gain)[0].real
    gains = "{} z1 + {} z2 + {} z3 + {} integral(z1)".format(*map(say, law.gain)).replace("+ -", "- ")
    time_s, peak_v = _settles(linear)[0], peak_voltage_v(PAPER, linear.voltage_v)[0]
    rows = [
        row("weights", f"v = {gains}; slowest pole {say(pole, 2)} rad/s", "linear, continuous", pole < 0),
        row("LQI settles", seconds(time_s), "linear, exact, 1 ms, no voltage limit", _near(0.1, 0.3, time_s)),
    ]
    for (key, name), pair in nonlinear.items():
        times = [_settles(response)[0] for response in pair]
        text = f"{seconds(times[0])} RK4, {seconds(times[1])} Euler"
        rows.append(row(key, text, f"nonlinear, 200 V, {name}, 1 ms", _near(0.1, 0.3, *times)))
    beyond = [percent(_overshoots(response)[0]) for response in (linear, *nonlinear["LQI settles", free])]
    text = f"linear {beyond[0]} and {say(peak_v)} V; nonlinear {beyond[1]} RK4, {beyond[2]} Euler"
    return [*rows, row("LQI peak", text, f"linear without a limit, exact; nonlinear, 200 V, {free}; 1 ms"), _load()]


def _load() -> Claim:
    pair = [lqi(PAPER, LqiWeights(integral_per_m2_s2=weight)).gain for weight in (1e4, 1e10)]
    law = IntegralFeedback(np.array(pair), MDP.voltage_limit_v)
    response = _response(law, 5.0, start_gap_m=np.full(2, PAPER.set_point_m), force_n=np.full((5000, 1), 500.0))
    error = np.abs(response.gap_m - PAPER.set_point_m)
    left = [percent(share) for share in error[-1] / error.max(axis=0)]
    text = f"{left[0]} of the largest error is left with the integral weight 1e4, {left[1]} with 1e10"
    return row("load", text, f"{EULER}, 500 N from the set-point, after 5 s")


def _escape_voltage(stop_m: float) -> int:
    """Smallest whole limit in volt with which full voltage turns a magnet at rest at 15 mm before `stop_m`."""
    free, point, limit = PAPER.model_copy(update={"gap_max_m": 1.0}), PAPER.equilibrium(), np.arange(1.0, 501.0)
    state = State(np.full(500, START[0]), np.zeros(500), np.full(500, point.current_a))
    largest = state.gap_m
    for _ in range(200):
        state = step(free, state, point.voltage_v + limit, MDP.plant_step_s, integrator="rk4")
        largest = np.maximum(largest, state.gap_m)
    return int(limit[np.argmax(largest < stop_m)])


def _sufficient_limit(plant: Plant) -> float:
    """Smallest limit in steps of 25 V from which on the LQI settles from 15 mm within 1 s; infinity above 300 V."""
    limits = np.arange(25.0, 301.0, 25.0)
    law = IntegralFeedback(lqi(PAPER, LqiWeights()).gain, limits)
    mdp = MDP.model_copy(update={"voltage_limit_v": limits})
    response = _response(law, 1.0, plant, mdp, start_gap_m=np.repeat(START, len(limits)))
    fails = np.flatnonzero(np.isnan(_settles(response)))
    return float(np.append(limits, np.inf)[fails[-1] + 1 if len(fails) else 0])


def _left_open() -> list[Claim]:
    once, law = Mdp(control_period_ms=1), pid(PidGains())
    lqr = [lqr_for_mdp(PAPER, once, MDP.voltage_limit_v, discount) for discount in (1.0, 0.99)]
    costs = [say(cost(PAPER, MDP, _response(each, 0.5))[0]) for each in lqr]
    stopped = PAPER.model_copy(update={"gap_max_m": np.array([0.0151, 0.016, 0.018])})
    beyond = map(percent, _overshoots(_response(law, 3.0, start_gap_m=np.repeat(START, 3), actual=stopped)))
    times = _settles(_response(law, 25.0, start_gap_m=TEN_STARTS))
    limits = (
        f"LQI settles from {say(_sufficient_limit(PAPER))} V on, without the stop at 16 mm from "
        f"{say(_sufficient_limit(OPEN))} V; full voltage turns back before 16 mm from {_escape_voltage(0.016)} V on, "
        f"before 18 mm from {_escape_voltage(0.018)} V"
    )
    count = f"PID settles from {(~np.isnan(times)).sum()} of 10 starts"
    rho = ", ".join(f"{x:g}" for x in (MDP.cost_gap_per_m2, MDP.cost_velocity_s2_per_m2, MDP.cost_voltage_per_v2))
    return [
        row("limit", limits, "nonlinear, from 15 mm; steps of 25 V, 1 s, Euler 1 ms; steps of 1 V, RK4 1 ms"),
        row("rho", f"LQR costs {costs[0]} with {rho}", f"{EULER}, from 15 mm, 0.5 s"),
        row("gamma", f"the LQR for 0.99 costs {costs[1]}, undiscounted", f"{EULER}, from 15 mm, 0.5 s"),
        row("stops", f"PID overshoots {', '.join(beyond)}", "nonlinear, 200 V, stop at 15.1, 16, 18 mm, Euler 1 ms"),
        row("starts", f"{count}, in {seconds(times.min())} to {seconds(times.max())}", f"{EULER}, 4 to 15 mm, 25 s"),
    ]


GROUPS: tuple[Callable[[], list[Claim]], ...] = (
    _model,
    _control_period,
    _pid_linear,
    _pid_responses,
    _noise,
    _lqi_responses,
    _left_open,
)
