"""Units at the edge: what a recipe declares is turned into SI once, by pint."""

from functools import cache
from typing import Any


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def dimension_of(unit: str) -> str:
    """Return the dimension of `unit` in words; ValueError if pint does not know it."""
    try:
        return str(_registry().Unit(unit).dimensionality)
    except Exception as error:  # pint raises many kinds, AttributeError and SyntaxError among them
        raise ValueError(f"unit {unit!r} is not known ({error})") from None


def to_si_factor(unit: str, si_unit: str) -> float:
    """Return the number that turns a value in `unit` into `si_unit`; ValueError if they measure different things."""
    dimension_of(unit)
    registry = _registry()
    try:
        return float(registry.Quantity(1.0, unit).to(si_unit).magnitude)
    except Exception:
        raise ValueError(f"unit {unit!r} cannot be turned into {si_unit!r}: it measures {dimension_of(unit)}") from None
