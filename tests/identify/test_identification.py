"""Known plants are found again, and what the samples cannot say is said."""

import numpy as np
import pytest

from maglev_offline.errors import InputError
from maglev_offline.identify.equations import declared_values
from maglev_offline.identify.identification import identify
from maglev_offline.identify.settings import IdentifySettings
from maglev_offline.identify.verdict import IDENTIFIED, NOT, NOT_FITTED
from maglev_offline.identify.windows import Kernel
from maglev_offline.physics.parameters import Plant

SETTINGS = IdentifySettings()


def found_of(samples, plant, **given):
    made = identify(samples, plant, IdentifySettings(**given))
    return made, {p.name: p for p in made.parameters}


@pytest.mark.parametrize("width", [1, 2, 3, 24])
def test_windows_are_exact_for_polynomials(width):
    kernel = Kernel(width, 0.01)
    t = np.arange(-kernel.half, kernel.half + 1) * 0.01
    np.testing.assert_allclose(kernel.weights(0).sum(), 1)
    np.testing.assert_allclose(kernel.held_weights(0.3, 2).sum(), 1)
    np.testing.assert_allclose(kernel.weights(1) @ (3 + 2 * t), -2, rtol=1e-9)
    np.testing.assert_allclose(kernel.weights(2) @ (3 + 2 * t + 5 * t**2), 10, rtol=1e-8, atol=1e-8)


def test_noise_free_recovery_to_a_percent(any_plant, simulate):
    made, found = found_of(simulate(any_plant, 1.0), any_plant)
    for name, true in declared_values(any_plant).items():
        if true:
            assert found[name].estimate == pytest.approx(true, rel=0.01), name
        assert found[name].verdict == IDENTIFIED, name
    assert made.facts["held_out_median_r2"]["voltage"] > 0.999
    assert made.facts["voltage_check"]["holds"]


@pytest.mark.parametrize("period_ms", [1.0, 10.0])
def test_the_truth_lies_within_the_intervals(any_plant, simulate, period_ms):
    _, found = found_of(simulate(any_plant, period_ms, noise=0.01), any_plant)
    # At 10 ms the voltage changes between the rows: its delay is then no number of the plant.
    names = [n for n in declared_values(any_plant) if n != "delay_samples" or period_ms == 1.0]
    assert [n for n in names if found[n].differs] == []
    assert found["gain_h_m_per_kg"].verdict == IDENTIFIED
    assert found["resistance_ohm"].verdict == IDENTIFIED


def test_a_wrong_declared_resistance_is_found(levitator, simulate):
    wrong = levitator.model_copy(update={"resistance_ohm": 0.6})
    made, found = found_of(simulate(levitator, 1.0, noise=0.01), wrong)
    assert found["resistance_ohm"].differs
    assert found["resistance_ohm"].estimate == pytest.approx(2.72, rel=0.02)
    check = made.facts["voltage_check"]
    assert not check["holds"]
    assert "0.6 ohm" in check["text"]
    assert check["voltage_exponent"] is None or check["voltage_exponent"] == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("delay", [1, 3])
def test_a_late_voltage_is_found(levitator, simulate, delay):
    samples = simulate(levitator, 2.0)
    # A row's voltage acts `delay` samples after the row: the column runs ahead.
    samples["voltage_v"] = samples.groupby("log_id")["voltage_v"].shift(-delay).ffill()
    _, found = found_of(samples, levitator)
    assert found["delay_samples"].estimate == pytest.approx(delay, abs=0.1)
    assert found["delay_samples"].verdict == IDENTIFIED


def test_at_a_constant_gap_offset_and_slope_of_the_inductance_are_not_told_apart(levitator, simulate):
    samples = simulate(levitator, 2.0)
    samples["gap_m"] = 0.005
    _, found = found_of(
        samples, levitator, parameters=("resistance_ohm", "inductance_offset_h", "inductance_slope_h_m")
    )
    for name in ("inductance_offset_h", "inductance_slope_h_m"):
        assert found[name].verdict == NOT
        assert found[name].error is None
    assert "inductance_slope_h_m" in found["inductance_offset_h"].reason
    assert found["resistance_ohm"].verdict == IDENTIFIED
    assert found["delay_samples"].verdict == NOT_FITTED


def test_rows_of_100_ms_are_refused_for_all_that_moves(simulate):
    made, found = found_of(simulate(Plant(), 100.0, seconds=20.0), Plant())
    assert made.facts["phase_per_sample_rad"] == pytest.approx(4.9, abs=0.3)
    for name in ("gain_h_m_per_kg", "pole_offset_m", "inductance_offset_h", "inductance_slope_h_m", "delay_samples"):
        assert found[name].verdict == NOT
        assert found[name].estimate is None
        assert "rad from row to row" in found[name].reason
    assert any("100 ms apart" in text for text in made.warnings)
    with pytest.raises(InputError, match="none of the parameters"):
        found_of(simulate(Plant(), 100.0, seconds=20.0), Plant(), parameters=("gain_h_m_per_kg",))


def test_between_the_limits_nothing_is_more_than_weak(simulate):
    made, found = found_of(simulate(Plant(), 40.0, seconds=20.0), Plant())
    assert IDENTIFIED not in {p.verdict for p in found.values()}
    assert any("warn_phase_rad" in text for text in made.warnings)


def test_the_same_samples_give_the_same_numbers(levitator, simulate):
    a, b = (identify(simulate(levitator, 10.0, noise=0.01), levitator, SETTINGS) for _ in range(2))
    assert a.parameters == b.parameters
    assert a.facts == b.facts


def test_bad_samples_are_refused_with_the_number(levitator, simulate):
    good = simulate(levitator, 10.0)
    nan = good["gap_m"].where(good.index != 17)
    cases = {
        r"0 rows": good.iloc[:0],
        r"gap_m is not finite in 1 of [\d,]+ rows \(the first is row 17\)": good.assign(gap_m=nan),
        r"all [\d,]+ rows are in contact": good.assign(contact=True),
        r"no excitation: gap_m = 0.005, current_a = 0.4, voltage_v = 1": good.assign(
            gap_m=0.005, current_a=0.4, voltage_v=1.0
        ),
        r"longest of 1 stretches has 9 rows, and one window needs": good.iloc[:9],
        r"60 free rows hold \d+ windows .* 7 parameters need 28": good.iloc[:60],
        r"10 to 20 ms apart": _mixed(good),
    }
    for text, samples in cases.items():
        with pytest.raises(InputError, match=text):
            identify(samples, levitator, SETTINGS)


def _mixed(good):
    import pandas as pd

    slow = good[good.step % 2 == 0].assign(log_id=lambda d: d.log_id + "slow", step=lambda d: d.step // 2)
    return pd.concat([good, slow], ignore_index=True)


def test_nothing_is_fitted_across_a_contact(levitator, simulate):
    good = simulate(levitator, 10.0)
    touched = good.assign(contact=good.step % 200 == 100)
    made, _ = found_of(touched, levitator)
    assert made.left_out["contact"] == int(touched.contact.sum())
    assert made.counts["stretches"] == 20


@pytest.mark.parametrize(
    "given", [{"parameters": ()}, {"identified_within": 0.6}, {"refuse_phase_rad": 1.0}, {"parameters": ("r",)}]
)
def test_settings_that_cannot_be(given):
    with pytest.raises(ValueError, match=r"parameter|weak_within|refuse_phase"):
        IdentifySettings(**given)
