"""A statement of the paper, what this code makes of it, and all the statements of sections II, VI-A and VI-B.

Source: Zhao et al. A verdict follows from a stated tolerance; what the paper gives no number for is "not testable".
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

Verdict = Literal["reproduced", "not reproduced", "not testable"]

STATEMENTS = {
    "kappa": ("II-B", "kappa = 4 m g / (mu0 N2 A): i = sqrt(kappa) x carries the mass", "force = weight", "1e-6 of it"),
    "current": ("II-B", "current at the set-point", "17.0 A", "half a unit of the last printed digit"),
    "matrices": (
        *("II-B", "matrices A and B", "2450, -1.1558, 2119.7, -3.1438; 2.6198"),
        "half a unit of the last printed digit",
    ),
    "output": ("II-B", "matrix C", "[1, 0, 0]", "exact"),
    "rank": ("II-B", "controllable and observable", "rank 3 and 3", "exact"),
    "poles": ("II-B", "unstable without control", "unstable", "a pole right of 0"),
    "period": (
        "II",
        "a control period under 10 ms controls the magnet",
        "under 10 ms",
        "2 % band, all starts, all under 10 ms",
    ),
    "kp": ("VI-A", "PID Kp 3100, Kd 310, Ki 300 stabilises", "stable at Kp 3100", "Kp inside the range"),
    "margins": ("VI-A", "phase, delay and gain margin of the PID", "not given", "-"),
    "sign": ("VI-A", "PID acts on y_r - y", "stable", "poles left of 0"),
    "PID settles": ("VI-A", "PID settles (2 %) from 15 mm", "5 s", "10 % of 5 s"),
    "PID overshoots": ("VI-A", "PID overshoots from 15 mm", "25 %", "10 % of 25 %"),
    "PID calm": ("VI-A", "PID settles (2 %) with f ~ N(0, 2.5e5), a variance: 500 N", "settles", "every draw"),
    "LQI calm": ("VI-B", "LQI settles (2 %) with f ~ N(0, 2.5e5), a variance: 500 N", "settles", "every draw"),
    "PID wild": ("II", "PID holds the magnet with f ~ N(0, 2.5e5), a standard deviation", "holds", "no contact"),
    "LQI wild": ("II", "LQI holds the magnet with f ~ N(0, 2.5e5), a standard deviation", "holds", "no contact"),
    "weights": ("VI-B", "Q = diag(3.16e10, 1e7, 0, 1e4), R = 1 stabilise", "stable", "poles left of 0"),
    "LQI settles": ("VI-B", "LQI settles (2 %) from 15 mm", "about 0.1 s", "30 % of 0.1 s"),
    "filter": (
        "VI-B",
        "LQI settles (2 %) from 15 mm with a filter that sees the gap only",
        "about 0.1 s",
        "30 % of 0.1 s",
    ),
    "LQI peak": ("VI-B", "overshoot and peak voltage of the LQI from 15 mm", "not given", "-"),
    "load": ("VI-B", "the integral of the LQI against a constant load", "not given", "-"),
    "limit": ("VI-B", "which voltage limit suffices", "not given", "-"),
    "rho": ("III", "weights rho of the cost", "not given", "-"),
    "gamma": ("III", "discount gamma", "not given", "-"),
    "stops": ("VI-A", "mechanical stops", "not given", "-"),
    "starts": ("VI-A", "start states", "not given", "-"),
}
"""Section, statement, what the paper says, tolerance of the verdict."""


@dataclass(frozen=True)
class Claim:
    """One statement of the paper and what this code makes of it; numbers are rounded so that machines agree."""

    section: str
    statement: str
    paper: str
    measured: str
    verdict: Verdict
    setting: str
    tolerance: str


def say(value: Any, digits: int = 3) -> str:
    """A number in so few digits that machines agree on them."""
    return f"{float(f'{float(value):.{digits}g}') + 0.0:g}"  # -0.0 + 0.0 is 0.0


def seconds(value: Any) -> str:
    """A time, or never."""
    return "never" if np.isnan(value) else f"{say(value)} s"


def percent(share: Any) -> str:
    """To 0.1 % at best: what is smaller is rounding noise."""
    return f"{say(round(100 * float(share), 1))} %"


def row(key: str, measured: str, setting: str, holds: Any = None) -> Claim:
    """The claim of that key in `STATEMENTS`; `holds`: whether it is reproduced, None where it cannot be tested."""
    section, statement, paper, tolerance = STATEMENTS[key]
    verdict: Verdict = "not testable" if holds is None else "reproduced" if holds else "not reproduced"
    return Claim(section, statement, paper, measured, verdict, setting, tolerance)
