"""How far a linear loop is from instability: root locus, range of Kp, gain, phase and delay margin.

The loop is broken at the plant input: with v = gain . (z, integral of z1) its open-loop transfer function is
L(s) = -gain . (s I - A)^-1 B, and the closed loop has its poles where 1 + L(s) = 0. For the paper's PID (Sec. VI-A)
that is L = -(Kp + Kd s + Ki / s) P(s), where the plant P from voltage to gap has a negative gain.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from maglev_offline.control.feedback import augmented
from maglev_offline.control.pid import PidGains, pid
from maglev_offline.control.reference import feedback_laws
from maglev_offline.control.settings import ControllerName, ControlSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.linear import LinearPlant, linearise
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

Sampling = Literal["continuous", "euler", "zoh"]
"""How time runs: continuously, by forward Euler, or exactly with the voltage held over each plant step."""

SAMPLINGS: tuple[Sampling, ...] = ("continuous", "euler", "zoh")

_SEARCH_POINTS = 2001


@dataclass(frozen=True)
class LoopMargins:
    """Margins of one loop; all NaN where the loop is unstable as given.

    The loop stays stable while its gain is multiplied by a factor between `gain_margin_down` (0: any) and
    `gain_margin_up` (infinite: any). `phase_margin_deg` is the smallest change of phase, lag or lead, that reaches
    the limit, at `crossover_rad_s`. `delay_margin_s` is the smallest delay that does (infinite: none): a delay only
    lags, so it may belong to another crossover.
    """

    stable: bool
    gain_margin_down: float = np.nan
    gain_margin_up: float = np.nan
    phase_margin_deg: float = np.nan
    crossover_rad_s: float = np.nan
    delay_margin_s: float = np.nan

    @property
    def verdict(self) -> str:
        """In words."""
        return "stable" if self.stable else "unstable as given"


@dataclass(frozen=True)
class KpRange:
    """The open interval of Kp, in V/m, in which the loop of a PID is stable; `step_s` is None in continuous time."""

    sampling: Sampling
    step_s: float | None
    lowest: float
    highest: float


@dataclass(frozen=True)
class RootLocus:
    """Closed-loop poles over Kp: gains `kp` [n] in V/m, `poles_rad_s` [n, k], each column one branch."""

    kp: Array
    poles_rad_s: NDArray[np.complex128]


def _characteristic(linear: LinearPlant) -> tuple[Array, float]:
    """Of P(s) = -b / D(s) from voltage to gap: D, highest power first, shape [4], and b in m/s^3 for a volt."""
    return np.poly(linear.a).astype(np.float64), float(-linear.a[1, 2] * linear.b[2, 0])


def open_loop(linear: LinearPlant, gain: Array) -> Any:
    """L(s) of a state feedback `gain` [4] as a transfer function of python-control; 1 + L = 0 is the closed loop."""
    import control

    d, b = _characteristic(linear)
    # The voltage moves the gap by -b / D, the velocity by -b s / D and the current by b3 (s^2 - A21) / D.
    numerator = b * np.array([0.0, 0.0, gain[1], gain[0]])
    numerator -= gain[2] * linear.b[2, 0] * np.array([0.0, 1.0, 0.0, -linear.a[1, 0]])
    if gain[3] == 0:
        return control.tf(numerator, d)
    return control.tf(np.append(numerator, b * gain[3]), np.append(d, 0.0))


def _instability(linear: LinearPlant, gain: Array, sampling: Sampling, step_s: float | None) -> Array:
    """Below 0 where the loop under `gain` [..., 4] is stable: largest real part in rad/s, or largest |z| - 1.

    The sampled loops are those of `simulate.regulate`: the voltage is held and the integral adds up z1 at its instants.
    """
    a, b = augmented(linear)
    if not np.any(gain[..., 3]):
        a, b, gain = a[:3, :3], b[:3], gain[..., :3]
    if sampling == "continuous" or step_s is None:
        return _largest(np.linalg.eigvals(a + b * gain[..., None, :]).real)
    if sampling == "euler":
        held, driven = np.eye(len(a)) + step_s * a, step_s * b
    else:
        held, driven = _zero_order_hold(a, b, step_s)
    return _largest(np.abs(np.linalg.eigvals(held + driven * gain[..., None, :])) - 1)


def _largest(values: NDArray[Any]) -> Array:
    largest: Array = np.asarray(values.max(axis=-1), dtype=np.float64)
    return largest


def _zero_order_hold(a: Array, b: Array, step_s: float) -> tuple[Array, Array]:
    from scipy.linalg import expm

    rate = np.zeros((4, 4))
    rate[:3, :3], rate[:3, 3:] = a[:3, :3], b[:3]
    exact = expm(step_s * rate)
    held, driven = np.eye(len(a)), np.zeros_like(b)
    held[:3, :3], driven[:3] = exact[:3, :3], exact[:3, 3:]
    held[3:, 0] = step_s
    return held, driven


def loop_is_stable(
    linear: LinearPlant, gain: Array, sampling: Sampling = "continuous", step_s: float | None = None
) -> bool:
    """Whether the loop under `gain` [4] is stable; gains that are not finite are not."""
    return bool(np.isfinite(gain).all() and _instability(linear, gain, sampling, step_s) < 0)


def loop_margins(linear: LinearPlant, gain: Array) -> LoopMargins:
    """Margins of the continuous loop under a state feedback `gain` [4], by python-control."""
    import control

    if not loop_is_stable(linear, gain):
        return LoopMargins(stable=False)
    loop = open_loop(linear, gain)
    factors, phases_deg, _, _, crossovers, _ = control.stability_margins(loop, returnall=True)
    factors, phases_deg, crossovers = (np.atleast_1d(x) for x in (factors, phases_deg, crossovers))
    phase_deg, crossover, delay_s = np.inf, np.nan, np.inf
    if len(crossovers):
        nearest = int(np.argmin(np.abs(phases_deg)))
        phase_deg, crossover = float(abs(phases_deg[nearest])), float(crossovers[nearest])
        delay_s = float(np.min(np.deg2rad(phases_deg % 360) / crossovers))
    return LoopMargins(
        stable=True,
        gain_margin_down=float(np.max(factors[factors < 1], initial=0.0)),
        gain_margin_up=float(np.min(factors[factors > 1], initial=np.inf)),
        phase_margin_deg=phase_deg,
        crossover_rad_s=crossover,
        delay_margin_s=delay_s,
    )


def margins_of_all(plant: Plant, mdp: Mdp, settings: ControlSettings) -> dict[ControllerName, LoopMargins]:
    """Margins of every feedback law on the linearised plant in continuous time, each loop broken at the plant input.

    Those of the held LQR are of its gains: holding the voltage takes from them.
    """
    linear = linearise(plant)
    return {name: loop_margins(linear, law.gain) for name, law in feedback_laws(plant, mdp, settings, None).items()}


def stable_kp_range(
    plant: Plant, gains: PidGains, sampling: Sampling = "continuous", step_s: float = 1e-3
) -> KpRange | None:
    """The range of Kp in which the PID's loop is stable with `gains.kd` and `gains.ki`; None: no Kp is.

    Continuous time is in closed form. The characteristic polynomial, by Routh, with r = -A33 and D = (1, r, e, d),

        s^4 + r s^3 + (e + b Kd) s^2 + (b Kp + d) s + b Ki,

    is stable for b Kp + d between r / 2 (p -+ sqrt(p^2 - 4 b Ki)), p = e + b Kd. Sampled time is by bisection on the
    eigenvalues, out of a search through that interval and its neighbourhood: a range narrower than 0.15 % of it
    is overlooked.
    """
    linear = linearise(plant)
    (_, r, e, d), b = _characteristic(linear)
    p, integral = e + b * gains.kd, b * gains.ki
    if p <= 0 or integral < 0 or p * p <= 4 * integral:
        return None
    half = np.sqrt(p * p - 4 * integral)
    lowest, highest = (float((r / 2 * (p + sign * half) - d) / b) for sign in (-1, 1))
    if sampling == "continuous":
        return KpRange(sampling, None, lowest, highest)
    return _sampled_range(linear, gains, sampling, step_s, (lowest, highest))


def _sampled_range(
    linear: LinearPlant, gains: PidGains, sampling: Sampling, step_s: float, near: tuple[float, float]
) -> KpRange | None:
    def instability(kp: Array) -> Array:
        gain = np.broadcast_to(pid(gains).gain, (*kp.shape, 4)).copy()
        gain[..., 0] = kp
        return _instability(linear, gain, sampling, step_s)

    width = near[1] - near[0]
    tried = np.linspace(near[0] - width, near[1] + width, _SEARCH_POINTS)
    stable = np.flatnonzero(instability(tried) < 0)
    if not len(stable):
        return None
    inside = tried[stable[[0, -1]]]
    outside = inside + np.array([-1.0, 1.0]) * (tried[1] - tried[0])
    for _ in range(60):
        middle = (inside + outside) / 2
        good = instability(middle) < 0
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
    return KpRange(sampling, step_s, float(inside[0]), float(inside[1]))


def root_locus(plant: Plant, gains: PidGains, kp: Array | None = None) -> RootLocus:
    """Closed-loop poles of the PID over Kp, in continuous time, by python-control.

    `kp`: gains [n] in V/m; by default 401 of them from 0 to one and a half times the larger of `gains.kp` and the
    highest stable one.
    """
    import control

    if kp is None:
        stable = stable_kp_range(plant, gains)
        kp = np.linspace(0, 1.5 * max(abs(gains.kp), stable.highest if stable else 0.0), 401)
    d, b = _characteristic(linearise(plant))
    # What Kp multiplies, with the loop of Kd and Ki closed: 1 + Kp b s / (s D + b Kd s^2 + b Ki) = 0.
    if gains.ki == 0:
        rest = control.tf([b], d + b * np.array([0.0, 0.0, gains.kd, 0.0]))
    else:
        rest = control.tf([b, 0.0], np.append(d, 0.0) + b * np.array([0.0, 0.0, gains.kd, 0.0, gains.ki]))
    found = control.root_locus_map(rest, gains=kp)
    return RootLocus(np.asarray(kp, dtype=np.float64), np.asarray(found.loci, dtype=np.complex128))
