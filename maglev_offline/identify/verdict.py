"""A verdict in words for each parameter, with the reason."""

from dataclasses import dataclass
from math import isfinite
from typing import Any, Literal

import numpy as np

from maglev_offline.identify.fit import Fit
from maglev_offline.identify.settings import IdentifySettings, Name
from maglev_offline.identify.uncertainty import Uncertainty

Word = Literal["identified", "weakly identified", "not identifiable from these samples", "not fitted"]
IDENTIFIED: Word = "identified"
WEAK: Word = "weakly identified"
NOT: Word = "not identifiable from these samples"
NOT_FITTED: Word = "not fitted"

ENTANGLED = 0.95
"""Estimates with a correlation above this are told apart badly."""


@dataclass(frozen=True)
class Parameter:
    """What is known of one parameter, SI units; None where there is no number (not fitted, or a flat direction)."""

    name: Name
    declared: float
    estimate: float | None
    error: float | None
    low: float | None
    high: float | None
    verdict: Word
    reason: str
    error_method: str

    @property
    def differs(self) -> bool:
        """Whether the declared value lies outside the interval."""
        return self.low is not None and self.high is not None and not self.low <= self.declared <= self.high


def judge(name: Name, declared: float, fitted: Fit, sure: Uncertainty, settings: IdentifySettings) -> Parameter:
    """Judge one fitted parameter by the half width of its interval over its scale, and by its bounds."""
    estimate, error, half = fitted.values[name], sure.error[name], sure.half_width[name]
    relative = half / max(fitted.scale[name], abs(estimate) if name != "delay_samples" else 1.0)
    partner = _partner(name, fitted, sure)
    confidence = f"{settings.confidence:.0%}"
    if not isfinite(half):
        word, reason = NOT, "the samples do not change with it" + (f" except through {partner}" if partner else "")
    elif name in fitted.at_bound:
        word, reason = NOT, f"the fit runs into the bound at {estimate:.3g}"
    else:
        word = IDENTIFIED if relative <= settings.identified_within else WEAK
        word = NOT if relative > settings.weak_within else word
        reason = f"the {confidence} interval is +- {relative:.1%} of the scale {fitted.scale[name]:.3g}"
        if word != IDENTIFIED and partner:
            reason += f", and it moves with {partner}"
        if word != IDENTIFIED and "jackknife" in sure.method[name]:
            reason += "; it changes from piece to piece of the recordings"
        if word != IDENTIFIED and "wider" in sure.method[name]:
            reason += "; it shifts with the width of the window"
    number = half if isfinite(half) else None
    return Parameter(
        name,
        declared,
        estimate,
        error if isfinite(error) else None,
        None if number is None else estimate - number,
        None if number is None else estimate + number,
        word,
        reason,
        sure.method[name],
    )


def _partner(name: Name, fitted: Fit, sure: Uncertainty) -> str:
    k = fitted.names.index(name)
    others = np.abs(sure.correlation[k]).copy()
    others[k] = 0
    most = int(np.argmax(others))
    if others[most] < ENTANGLED:
        return ""
    return f"{fitted.names[most]} (correlation {sure.correlation[k, most]:+.3f})"


def limited(parameter: Parameter, reason: str) -> Parameter:
    """The same, at best weakly identified, for a reason that concerns its whole equation."""
    word = WEAK if parameter.verdict == IDENTIFIED else parameter.verdict
    return Parameter(**{**vars(parameter), "verdict": word, "reason": f"{parameter.reason}; {reason}"})


def left_out(name: Name, declared: float, reason: str, *, asked: bool) -> Parameter:
    """A parameter that was not fitted: not asked for, or refused."""
    return Parameter(name, declared, None, None, None, None, NOT if asked else NOT_FITTED, reason, "")


def table_rows(parameters: tuple[Parameter, ...]) -> list[list[str]]:
    """Rows for people: parameter, declared, estimate with its standard error, interval, verdict with reason."""
    return [
        [
            p.name,
            f"{p.declared:.4g}",
            "-" if p.estimate is None else f"{p.estimate:.4g} +- {'?' if p.error is None else f'{p.error:.2g}'}",
            "-" if p.low is None or p.high is None else f"{p.low:.4g} to {p.high:.4g}",
            f"{p.verdict}: {p.reason}" if p.verdict != IDENTIFIED else p.verdict,
        ]
        for p in parameters
    ]


def plain(parameter: Parameter) -> dict[str, Any]:
    """For scripts."""
    return {**vars(parameter), "declared_outside_interval": parameter.differs}
