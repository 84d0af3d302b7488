"""Numbers as a reader sees them: a true minus sign, thousands in groups, as many digits as they deserve."""

import math
from collections.abc import Sequence

import numpy as np

NOTHING = "–"
"""Stands for a number that does not exist."""

NO_BREAK = "\N{NO-BREAK SPACE}"

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | int | None, digits: int = 3) -> str:
    """Write a number with `digits` significant digits; `–` where there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0:
        return "0"
    size = abs(value)
    if size >= 1e7 or size < 1e-4:
        mantissa, exponent = f"{size:.{digits - 1}e}".split("e")
        text = f"{mantissa} × {power_of_ten(int(exponent))}"
    else:
        decimals = max(0, digits - 1 - math.floor(math.log10(float(f"{size:.{digits - 1}e}"))))
        text = f"{size:,.{decimals}f}"
    return f"−{text}" if value < 0 else text


def whole(value: float | int | None) -> str:
    """Write a count, thousands in groups."""
    return NOTHING if value is None or not math.isfinite(value) else f"{round(value):,}".replace("-", "−")


def plain(value: float) -> str:
    """Write a number that a person chose, such as a duration, with no more digits than it has."""
    return f"{value:g}".replace("-", "−")


def percent(share: float | None) -> str:
    """Write a share as per cent, without claiming 0 or 100 for what is not."""
    if share is None or not math.isfinite(share):
        return NOTHING
    if 0 < share < 0.0005 or 0.9995 < share < 1:
        return f"< 0.1{NO_BREAK}%" if share < 0.5 else f"> 99.9{NO_BREAK}%"
    return f"{100 * share:.3g}{NO_BREAK}%"


def interval(low: float | None, high: float | None, digits: int = 3) -> str:
    """Write an interval as `low to high`."""
    if low is None or high is None:
        return NOTHING
    return f"{number(low, digits)} to {number(high, digits)}".replace(" ", NO_BREAK)


def spread(values: Sequence[float] | np.ndarray, scale: float = 1.0, digits: int = 3) -> str:
    """Write `median (lower quartile to upper quartile)` of the numbers that exist, the quartiles with a digit less."""
    data = np.asarray(values, dtype=float) * scale
    data = data[np.isfinite(data)]
    if not len(data):
        return NOTHING
    low, middle, high = np.quantile(data, [0.25, 0.5, 0.75])
    if len(data) == 1:
        return number(middle, digits)
    low_text, high_text = number(low, digits - 1), number(high, digits - 1)
    around = low_text if low_text == high_text else f"{low_text} to {high_text}".replace(" ", NO_BREAK)
    return f"{number(middle, digits)} ({around})"


def power_of_ten(exponent: int) -> str:
    """Write 10 to a power with raised digits."""
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def listing(parts: Sequence[str]) -> str:
    """Join words as in speech: `a`, `a and b`, `a, b and c`."""
    if len(parts) < 2:
        return "".join(parts)
    return f"{', '.join(parts[:-1])} and {parts[-1]}"
