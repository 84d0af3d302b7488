"""Whether the declared unit of a signal can be right, and which would be."""

from math import log as ln

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.checks.codes import make
from maglev_offline.ingest.checks.settings import CheckSettings
from maglev_offline.ingest.findings import Finding
from maglev_offline.logs.signals import UNIT_OF_SIGNAL, Signal
from maglev_offline.logs.units import to_si_factor

Array = NDArray[np.float64]

_CANDIDATES = {
    "gap": ("m", "mm", "um", "cm", "inch"),
    "current": ("A", "mA", "kA"),
    "voltage": ("V", "mV", "kV"),
}


def suspect(
    name: tuple[str, str, str],
    signal: str,
    ordered: Array,
    expected: float | None,
    declared: Signal,
    settings: CheckSettings,
) -> list[Finding]:
    """Hold the upper quartile of a signal (SI, sorted) against the plant's operating value; `name`: log, topic, point.

    The upper quartile, since a log may well have the magnet switched off for half of its time.
    """
    if expected is None or len(ordered) == 0:
        return []
    typical = abs(float(ordered[(3 * len(ordered)) // 4]))
    factor = typical / expected
    if typical == 0 or 1 / settings.unit_factor < factor < settings.unit_factor:
        return []
    si_unit = UNIT_OF_SIGNAL[signal]
    declared_unit = to_si_factor(declared.unit, si_unit)
    # Logarithms one by one: the smallest of numbers, over anything, would be 0.
    off = {
        unit: abs(ln(typical) - ln(expected) + ln(to_si_factor(unit, si_unit) / declared_unit))
        for unit in _CANDIDATES[signal]
    }
    best = min(off, key=lambda unit: off[unit])
    numbers: dict[str, float | int | str] = {
        "signal": signal,
        "typical": typical,
        "expected": expected,
        "factor": factor,
        "unit": si_unit,
        "declared": declared.unit,
        "suggested": best if off[best] < ln(settings.unit_factor) else "none of the usual ones",
        "of": len(ordered),
    }
    return [make("unit_suspect", *name, numbers)]
