"""Units are turned into SI once, at the edge."""

import pytest

from maglev_offline.logs.units import dimension_of, to_si_factor


@pytest.mark.parametrize(
    ("unit", "si_unit", "factor"),
    [("mm", "m", 1e-3), ("um", "m", 1e-6), ("mm/s", "m/s", 1e-3), ("km/h", "m/s", 1 / 3.6), ("mA", "A", 1e-3),
     ("kV", "V", 1e3), ("m", "m", 1.0), ("ns", "s", 1e-9), ("tonne", "kg", 1e3)],
)  # fmt: skip
def test_factor_to_si(unit, si_unit, factor):
    assert to_si_factor(unit, si_unit) == pytest.approx(factor, rel=1e-15)


def test_a_length_is_no_voltage():
    with pytest.raises(ValueError, match=r"'mm' cannot be turned into 'V': it measures \[length\]"):
        to_si_factor("mm", "V")


@pytest.mark.parametrize("unit", ["furlongs per", "mmm", "", "m/"])
def test_an_unknown_unit(unit):
    if unit == "":
        assert dimension_of(unit) == "dimensionless"
    else:
        with pytest.raises(ValueError, match=f"^'{unit}' is no unit that is known$"):
            dimension_of(unit)


def test_a_unit_with_a_zero_of_its_own_is_refused():
    with pytest.raises(ValueError, match="zero of its own"):
        to_si_factor("degC", "kelvin")
