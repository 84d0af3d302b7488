"""The paper's PID, and a cascade with a current loop inside: the fair baseline."""

import numpy as np
from pydantic import Field

from maglev_offline.control.feedback import IntegralFeedback
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant
from maglev_offline.settings import Settings


class PidGains(Settings):
    """v = Kp z1 + Kd z2 + Ki integral(z1): the gains of the paper, Sec. VI-A, in V/m, V s/m, V/(m s).

    A weak baseline: on the paper's plant its phase margin is 2.5 degrees.
    """

    kp: float = 3100.0
    kd: float = 310.0
    ki: float = 300.0


class CascadeGains(Settings):
    """A gap loop that asks for a current, and a current loop three to five times faster that gives it.

    Given as the closed loop that is wanted, so that one table fits plants of any size: the gap loop is a spring and
    a damper of `gap_bandwidth_rad_s` and `gap_damping`, the current loop is of first order, and the integral removes
    a constant load at `integral_rate_rad_s`. The defaults put the gap loop just under the plant's own unstable
    rate sqrt(2 g / x_eq) = 49.5 rad/s, where 200 V still suffices from most gaps, damp it critically, and make the
    integral slow enough not to overshoot after a saturated start.
    """

    gap_bandwidth_rad_s: float = Field(default=45.0, gt=0)
    gap_damping: float = Field(default=1.0, gt=0)
    current_bandwidth_rad_s: float = Field(default=200.0, gt=0)
    integral_rate_rad_s: float = Field(default=0.3, ge=0)


def pid(gains: PidGains, voltage_limit_v: float | None = None) -> IntegralFeedback:
    """The PID as a controller (paper, Sec. VI-A)."""
    return IntegralFeedback(np.array([gains.kp, gains.kd, 0.0, gains.ki]), voltage_limit_v)


def cascade(plant: Plant, gains: CascadeGains, voltage_limit_v: float | None = None) -> IntegralFeedback:
    """The cascade as a controller, designed on the linearised plant.

    Outer loop: z3_ref = kx z1 + kv z2 + ki integral(z1), for z1'' + 2 d w z1' + w^2 z1 = 0 with an ideal current.
    Inner loop: v = R z3_ref + kc (z3_ref - z3), with kc = bandwidth times inductance.
    """
    linear = linearise(plant)
    unstable_per_s2, amperes_to_m_s2 = linear.a[1, 0], -linear.a[1, 2]
    coil_h = 1 / linear.b[2, 0]
    w = gains.gap_bandwidth_rad_s
    reference = np.array([unstable_per_s2 + w**2, 2 * gains.gap_damping * w, 0.0, gains.integral_rate_rad_s * w**2])
    kc = gains.current_bandwidth_rad_s * coil_h
    gain = (plant.resistance_ohm + kc) * reference / amperes_to_m_s2
    gain[2] = -kc
    return IntegralFeedback(gain, voltage_limit_v)
