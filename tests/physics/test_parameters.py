"""Parameters: the paper's numbers, the laboratory levitator, and what a recipe may not say."""

import pytest
from pydantic import ValidationError

from maglev_offline.physics.parameters import Plant


def test_paper_plant() -> None:
    plant = Plant()
    assert plant.kappa == pytest.approx(4.4930e6, rel=1e-5)
    assert plant.equilibrium().current_a == pytest.approx(16.957, abs=5e-4)
    assert plant.equilibrium().voltage_v == pytest.approx(20.35, abs=5e-3)


def test_coil_gives_the_slope() -> None:
    assert Plant(coil_turns=450, pole_area_m2=0.024) == Plant().model_copy(
        update={"coil_turns": 450.0, "pole_area_m2": 0.024}
    )


def test_levitator_carries_its_mass(levitator: Plant) -> None:
    point = levitator.equilibrium()
    force_n = levitator.inductance_slope_h_m * point.current_a**2 / (2 * (0.005 + 0.0052) ** 2)
    assert force_n == pytest.approx(0.018 * 9.81, rel=1e-4)
    assert point.voltage_v == pytest.approx(2.72 * point.current_a)


@pytest.mark.parametrize(
    "wrong",
    [
        {"coil_turns": 450},
        {"coil_turns": 450, "pole_area_m2": 0.024, "inductance_slope_h_m": 1.0},
        {"set_point_m": 0.017},
        {"gap_min_m": 0.0},
        {"mass_kg": float("nan")},
        {"turns": 450},
    ],
)
def test_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        Plant(**wrong)


@pytest.mark.parametrize(
    "values", [{"mass_kg": 1e308}, {"resistance_ohm": 1e308}, {"coil_turns": 1e200, "pole_area_m2": 1}]
)
def test_a_plant_that_no_current_can_hold_is_none(values):
    with pytest.raises(ValidationError, match=r"no current holds the mass|no finite inductance"):
        Plant.model_validate(values)
