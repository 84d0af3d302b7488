"""What limits a point's samples: each limit is found where it is put in, and not elsewhere."""

import numpy as np
import pytest

from maglev_offline.ingest.checks import CheckSettings
from maglev_offline.ingest.ledger import rows
from maglev_offline.physics.dynamics import inductance
from maglev_offline.physics.parameters import Plant


@pytest.fixture
def swinging(samples):
    """Make a point whose voltage obeys u = R i + d/dt(L i) exactly, with that resistance."""

    def make(resistance_ohm=1.2, *, n=2000, period_ms=10, noise_v=0.0, rad_per_row=0.15, **more):
        t = np.arange(n) * rad_per_row
        rng = np.random.default_rng(0)
        gap = 0.008 + 5e-4 * np.sin(t) + 2e-4 * np.sin(0.31 * t)
        current = 17 + np.sin(0.7 * t) + 0.5 * np.cos(0.23 * t)
        flux_rate = np.gradient(inductance(Plant(), gap) * current, period_ms / 1e3)
        voltage = resistance_ohm * current + flux_rate + noise_v * rng.normal(size=n)
        return samples(gap=gap, current=current, voltage=voltage, period_ms=period_ms, **more)

    return make


class TestVoltage:
    def test_a_voltage_that_fits_the_declared_resistance_is_no_finding(self, swinging, point_codes):
        assert "voltage_mismatch" not in point_codes(swinging(noise_v=2.0))

    @pytest.mark.parametrize("resistance_ohm", [0.6, 3.0])
    def test_one_that_asks_for_another_is_told_with_an_interval(self, swinging, point_codes, resistance_ohm):
        numbers = point_codes(swinging(resistance_ohm, noise_v=2.0))["voltage_mismatch"].numbers
        assert numbers["resistance_ohm"] == pytest.approx(resistance_ohm, rel=0.05)
        assert numbers["low_ohm"] < resistance_ohm < numbers["high_ohm"]
        assert numbers["share_explained"] == pytest.approx(1.2 / resistance_ohm, rel=0.1)

    def test_a_window_never_reaches_over_the_end_of_a_segment(self, swinging, point_codes):
        point = swinging(n=400, segment=np.arange(400) // 20)
        assert "voltage_mismatch" not in point_codes(swinging(3.0, n=400, segment=np.arange(400) // 20))
        assert "voltage_mismatch" not in point_codes(point)

    def test_a_gap_that_reads_0_is_no_trouble(self, swinging, point_codes):
        point = swinging()
        point.values["gap_m"][500:520] = 0.0
        assert "voltage_mismatch" not in point_codes(point)


class TestContact:
    def test_runs_are_put_together_from_the_ledger_and_the_rows_that_stayed(self, swinging, point_codes):
        contact = np.zeros(2000, dtype=np.bool_)
        contact[999] = True
        point = swinging(segment=(np.arange(2000) >= 1000).astype(int), contact=contact)
        aside = point.t_ns[999] + np.arange(1, 6) * 10_000_000
        point.entries.append(rows("F1", "t", "contact", aside))
        finding = point_codes(point)["contact"]
        assert finding.count == 1
        assert (finding.places[0].start_ns, finding.places[0].end_ns) == (point.t_ns[999], aside[-1])
        assert finding.numbers["share"] == pytest.approx(6 / 2000)
        assert finding.severity == "info"

    def test_much_of_it_is_a_warning(self, swinging, point_codes):
        contact = np.arange(2000) % 50 == 0
        assert point_codes(swinging(contact=contact))["contact"].severity == "warning"

    def test_a_point_all_of_whose_rows_are_gone_still_tells(self, samples, point_codes):
        aside = rows("F1", "t", "contact", np.arange(3) * 10_000_000)
        finding = point_codes(samples(gap=[], current=[], voltage=[], velocity=np.empty(0), entries=[aside]))["contact"]
        assert finding.numbers["share"] == 1


class TestTimeBase:
    def test_rows_of_10_ms_resolve_the_plant(self, swinging, point_codes):
        assert "coarse_time_base" not in point_codes(swinging())

    def test_rows_of_100_ms_do_not(self, swinging, point_codes):
        numbers = point_codes(swinging(period_ms=100))["coarse_time_base"].numbers
        assert numbers["phase_plant_rad"] == pytest.approx(2.026, rel=0.01)

    @pytest.mark.parametrize("rad_per_row", [1.6, 2.2, 3.06])
    def test_a_swing_that_is_faster_than_the_plant_is_seen(self, swinging, point_codes, rad_per_row):
        numbers = point_codes(swinging(rad_per_row=rad_per_row))["coarse_time_base"].numbers
        assert numbers["phase_seen_rad"] == pytest.approx(rad_per_row, abs=0.06)

    def test_the_limit_is_a_setting(self, swinging, point_codes):
        assert "coarse_time_base" in point_codes(swinging(), settings=CheckSettings(largest_phase_rad=0.1))


class TestActionVariance:
    @pytest.mark.parametrize(("noise_v", "share", "severity"), [(0.1, 0.01, "warning"), (1.0, 0.5, "info")])
    def test_what_a_feedback_law_leaves_is_what_was_added_to_it(self, samples, point_codes, noise_v, share, severity):
        rng = np.random.default_rng(0)
        z = rng.normal(size=(3, 5000))
        voltage = 20 + z[0] * 0.8 + z[1] * 0.5 - 0.33 * z[2] + noise_v * rng.normal(size=5000)
        point = samples(gap=0.008 + 1e-3 * z[0], current=17 + z[1], velocity=0.1 * z[2], voltage=voltage)
        finding = point_codes(point)["action_variance"]
        assert finding.numbers["share_left"] == pytest.approx(share, rel=0.15)
        assert finding.severity == severity

    def test_a_constant_voltage_says_nothing(self, samples, point_codes):
        n = np.arange(500)
        assert "action_variance" not in point_codes(
            samples(gap=0.008 + 1e-4 * np.sin(n), current=17 + n / 500, voltage=20 + 0 * n)
        )


@pytest.mark.parametrize("n", [0, 1, 2, 5])
def test_next_to_no_rows_give_no_finding(samples, point_codes, n):
    point = samples(gap=[0.008] * n, current=[17.0] * n, voltage=[20.0] * n, velocity=np.zeros(n))
    assert point_codes(point) == {}
