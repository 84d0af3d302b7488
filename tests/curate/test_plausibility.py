"""Logs that do not fit the plant are doubted in words; logs that do are not."""

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate.plausibility import implausible
from maglev_offline.physics.parameters import Plant

PLANT = Plant()


def at_rest(samples_of, plant, rows=200, seed=0):
    """Samples about the set-point, the current and the voltage that carry the mass there."""
    rng = np.random.default_rng(seed)
    point = plant.equilibrium()
    gap = point.gap_m * (1 + 0.1 * rng.standard_normal(rows).clip(-3, 3))
    return samples_of(
        gap,
        set_point_m=point.gap_m,
        current_a=point.current_a * (1 + 0.1 * rng.standard_normal(rows)),
        voltage_v=point.voltage_v * (1 + 0.2 * rng.standard_normal(rows)),
    )


def test_the_right_plant_has_no_doubts(samples_of, any_plant):
    assert implausible(at_rest(samples_of, any_plant), any_plant) == []


def test_a_noisy_controller_that_throws_the_voltage_about_has_no_doubts(samples_of, any_plant):
    table = at_rest(samples_of, any_plant)
    rng = np.random.default_rng(1)
    table["voltage_v"] += 10 * any_plant.equilibrium().voltage_v * rng.uniform(-0.5, 0.5, len(table))
    assert implausible(table, any_plant) == []


@pytest.mark.parametrize(
    ("column", "factor", "says"),
    [
        ("current_a", 1e3, ["logged current (median 1.66e+04 A) does not fit what carries 700 kg", "gap (17 A)"]),
        ("current_a", 1e-3, ["logged current (median 0.0166 A) is nowhere near", "carries 700 kg (17 A)"]),
        ("current_a", -1, ["logged current (median -16.6 A) is nowhere near", "carries 700 kg (17 A)"]),
        ("gap_m", 100, ["logged gap (median 0.80", "m) does not fit the set-point (0.008 m)"]),
        ("gap_m", 0.1, ["logged gap (median 0.00080", "m) does not fit the set-point (0.008 m)"]),
        ("voltage_v", 1e3, ["voltage over current (median 1.", "e+03 ohm) does not fit the resistance", "(1.2 ohm)"]),
    ],
    ids=["current in mA", "current in kA", "current turned about", "gap in cm", "gap in cm for mm", "voltage in mV"],
)
def test_a_wrong_unit_is_doubted_first_of_all_with_both_numbers(samples_of, column, factor, says):
    table = at_rest(samples_of, PLANT)
    table[column] *= factor
    doubt = implausible(table, PLANT)[0]
    assert all(part in doubt for part in says), doubt
    assert doubt.endswith("is its unit right, and is [plant] that of the logs?")


def test_a_gap_in_the_wrong_unit_does_not_throw_doubt_on_a_current_that_is_right(samples_of):
    table = at_rest(samples_of, PLANT)
    table["gap_m"] *= 100
    assert len(implausible(table, PLANT)) == 1


def test_the_plant_of_a_train_is_doubted_for_a_ball_of_18_g(samples_of, levitator):
    table = at_rest(samples_of, levitator)
    doubts = implausible(table, levitator.model_copy(update={"mass_kg": 700.0}))
    carried = levitator.equilibrium().current_a * np.sqrt(700 / levitator.mass_kg)
    assert len(doubts) == 1
    assert "carries 700 kg" in doubts[0]
    assert f"(median {table['current_a'].median():.3g} A)" in doubts[0]
    assert float(doubts[0].split("700 kg (")[1].split(" A")[0]) == pytest.approx(carried, rel=0.05)


@pytest.mark.parametrize(("factor", "doubted"), [(1.9, False), (1 / 1.9, False), (2.2, True), (1 / 2.2, True)])
def test_a_factor_of_two_either_way_is_believed(samples_of, factor, doubted):
    _, current, voltage = PLANT.equilibrium()
    table = samples_of([0.008] * 9, current_a=current * factor, voltage_v=voltage * factor)
    assert bool(implausible(table, PLANT)) == doubted


@pytest.mark.parametrize(
    ("strange", "why"),
    [
        ({"contact": True, "gap_m": 0.0001, "current_a": 300.0}, "in contact"),
        ({"current_a": 0.0, "voltage_v": 500.0}, "without current"),
        ({"gap_m": np.nan}, "no gap"),
        ({"current_a": np.nan}, "no current"),
        ({"voltage_v": np.inf}, "no voltage"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_rows_that_cannot_tell_do_not_count(samples_of, strange, why):
    believed = at_rest(samples_of, PLANT, 100)
    other = at_rest(samples_of, PLANT, 900).assign(**strange)
    assert implausible(pd.concat([believed, other]), PLANT) == [], why


def test_a_log_that_cannot_tell_at_all_has_no_doubts(samples_of):
    assert implausible(samples_of([0.008] * 5, contact=True, current_a=300.0), PLANT) == []
    assert implausible(samples_of([np.nan] * 5), PLANT) == []
    assert implausible(samples_of([]), PLANT) == []


def test_a_magnet_that_is_never_on_is_doubted(samples_of):
    (doubt,) = implausible(samples_of([0.008] * 5, current_a=0.0), PLANT)
    assert "current (median 0 A) is nowhere near" in doubt
