"""Units at the edge: what a recipe declares is turned into SI once, by pint."""

from functools import cache
from typing import Any


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


@cache
def dimension_of(unit: str) -> str:
    """Return the dimension of `unit` in words; ValueError if pint does not know it."""
    try:
        return str(_registry().Unit(unit).dimensionality)
    except Exception:  # pint raises many kinds, AttributeError and SyntaxError among them
        raise ValueError(f"{unit!r} is no unit that is known") from None


@cache
def to_si_factor(unit: str, si_unit: str) -> float:
    """Return the number that turns a value in `unit` into `si_unit`; ValueError if they measure different things."""
    dimension_of(unit)
    registry = _registry()
    try:
        zero, one = (float(registry.Quantity(value, unit).to(si_unit).magnitude) for value in (0.0, 1.0))
    except Exception:
        text = f"unit {unit!r} cannot be turned into {si_unit!r}: it measures {dimension_of(unit)}"
        raise ValueError(f"{text}, where {dimension_of(si_unit)} is needed") from None
    if zero != 0:
        raise ValueError(f"unit {unit!r} has a zero of its own: give a unit without one, and state the offset")
    return one
