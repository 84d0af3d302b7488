"""Defects of signals, put in at known messages, are found there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from maglev_offline.logs.signals import Signal


def only(found, code):
    """The one finding, of that code."""
    assert list(found) == [code]
    assert len(found[code]) == 1
    return found[code][0]


def messages_of(finding):
    return [(place.first_message, place.last_message) for place in finding.places]


class TestStuck:
    @hypothesis_settings(deadline=None, max_examples=20)
    @given(first=st.integers(0, 800), length=st.integers(100, 190), signal=st.sampled_from(["gap", "current"]))
    def test_a_signal_that_stands_while_others_move_is_found(self, checked, topics, first, length, signal):
        columns = topics.columns()
        column = columns.values[signal]
        column[first : first + length] = (column.min() + column.max()) / 2
        finding = only(checked(columns), "stuck")
        assert messages_of(finding) == [(first, first + length - 1)]
        assert finding.numbers["signal"] == signal
        assert finding.numbers["longest_messages"] == length
        assert finding.severity == "error"

    def test_a_shorter_stand_is_not(self, checked, topics):
        columns = topics.columns()
        columns.values["gap"][200:290] = 0.00805
        assert checked(columns) == {}

    def test_a_whole_log_at_rest_is_not(self, checked, topics):
        columns = topics.columns()
        for name in columns.values:
            columns.values[name][:] = columns.values[name][0]
        assert checked(columns) == {}

    def test_a_gap_at_its_stop_is_not(self, checked, topics):
        columns = topics.columns()
        columns.values["gap"][300:500] = 0.016
        assert "stuck" not in checked(columns)

    def coarse(self, topics):
        """A gap by a converter of few bits: it swings over several levels, then rests within one step, then swings."""
        columns = topics.columns()
        gap = columns.values["gap"]
        gap[300:500] = 0.008 + 1e-5 * np.sin(np.arange(200) / 20)
        gap[:] = np.rint(gap / 2.5e-4) * 2.5e-4
        gap[[298, 299, 500, 501]] = 0.00825
        return columns

    def test_a_coarse_signal_that_rests_on_one_level_is_not(self, checked, topics):
        assert list(checked(self.coarse(topics))) == ["quantised"]

    def test_it_may_rest_as_well_where_the_log_ends(self, checked, topics):
        columns = self.coarse(topics)
        columns.values["gap"][850:] = columns.values["gap"][849]
        assert list(checked(columns)) == ["quantised"]

    def test_a_coarse_signal_that_is_stuck_and_comes_back_elsewhere_is_found(self, checked, topics):
        columns = self.coarse(topics)
        columns.values["gap"][500:505] = 0.0085
        assert messages_of(checked(columns)["stuck"][0]) == [(300, 499)]

    def test_a_coarse_signal_that_stands_to_the_end_and_never_rested_before_is_found(self, checked, topics):
        columns = topics.columns()
        gap = columns.values["gap"]
        gap[:] = np.rint(gap / 1e-4) * 1e-4
        gap[850:] = gap[849]
        assert checked(columns)["stuck"][0].places[0].last_message == 999

    def test_a_set_point_that_stands_is_not(self, checked, topics):
        columns = topics.columns()
        columns.values["set_point"] = np.full(1000, 0.008)
        assert checked(columns, using=topics.map(set_point=Signal(field="set_point", unit="m"))) == {}


class TestQuantised:
    @pytest.mark.parametrize(("signal", "quantum"), [("gap", 48.8e-6), ("current", 0.1), ("voltage", 0.5)])
    def test_a_coarse_quantum_is_measured(self, checked, topics, signal, quantum):
        columns = topics.columns(3000)
        column = columns.values[signal]
        column[:] = np.rint(column / quantum) * quantum
        finding = only(checked(columns), "quantised")
        assert finding.numbers["signal"] == signal
        assert finding.numbers["quantum"] == pytest.approx(quantum, rel=1e-3)

    @pytest.mark.parametrize(("signal", "quantum"), [("gap", 2e-6), ("current", 0.005), ("voltage", 0.02)])
    def test_a_fine_one_is_not_told(self, checked, topics, signal, quantum):
        columns = topics.columns(3000)
        column = columns.values[signal]
        column[:] = np.rint(column / quantum) * quantum
        assert checked(columns) == {}

    def test_one_that_is_fine_for_the_plant_and_coarse_for_the_signal_is_told(self, checked, topics):
        columns = topics.columns(3000)
        column = columns.values["gap"]
        column[:] = 0.008 + np.rint((column - column.mean()) / 15 / 1e-5) * 1e-5
        assert only(checked(columns), "quantised").numbers["quantum"] == pytest.approx(1e-5, rel=1e-3)


class TestSaturated:
    @pytest.mark.parametrize("noise_v", [0.0, 0.005])
    def test_a_voltage_at_its_limit_is_found_with_its_runs(self, checked, topics, noise_v):
        columns = topics.columns()
        voltage = columns.values["voltage"]
        voltage[:] = voltage.clip(None, 21)
        runs = int(np.sum(np.diff(np.concatenate([[False], voltage == 21]).astype(int)) == 1))
        at = np.flatnonzero(voltage == 21)
        voltage[:] += noise_v * np.random.default_rng(3).uniform(-1, 1, 1000)
        found = checked(columns)["saturated"]
        assert len(found) == 1
        finding = found[0]
        assert finding.numbers["limit"] == "upper"
        assert finding.numbers["messages"] == pytest.approx(len(at), rel=0.05)
        assert finding.count == pytest.approx(runs, rel=0.1)
        assert finding.places[0].first_message == at[0]

    def test_both_limits_are_told_apart(self, checked, topics):
        columns = topics.columns()
        columns.values["voltage"][:] = columns.values["voltage"].clip(19, 21)
        assert sorted(f.numbers["extreme"] for f in checked(columns)["saturated"]) == [19, 21]

    def test_a_sine_that_lingers_at_its_crests_is_not(self, checked, topics):
        columns = topics.columns()
        columns.values["voltage"][:] = 20 + np.sin(np.arange(1000) / 20)
        assert checked(columns) == {}


class TestRange:
    def test_a_negative_gap_is_an_error(self, checked, topics):
        columns = topics.columns()
        columns.values["gap"][[100, 101, 500]] -= 0.02
        finding = checked(columns)["gap_below_zero"][0]
        assert messages_of(finding) == [(100, 101), (500, 500)]
        assert finding.severity == "error"

    def test_noise_at_the_stops_is_no_finding(self, checked, topics):
        columns = topics.columns()
        columns.values["gap"][300:320] = 0.016 + 5e-6 * np.random.default_rng(0).normal(size=20)
        assert checked(columns) == {}

    def test_a_gap_over_the_stop_is_told(self, checked, topics):
        columns = topics.columns()
        columns.values["gap"][300:320] = np.linspace(0.017, 0.018, 20)
        finding = only(checked(columns), "gap_beyond_stop")
        assert messages_of(finding) == [(300, 319)]
        assert finding.numbers["largest"] == pytest.approx(0.018)

    def test_a_negative_current_is_told(self, checked, topics):
        columns = topics.columns()
        columns.values["current"][600:610] = np.linspace(-2, -3, 10)
        assert messages_of(only(checked(columns), "current_below_zero")) == [(600, 609)]


class TestUnits:
    @pytest.mark.parametrize(
        ("signal", "factor", "fits"),
        [("gap", 1e3, "mm"), ("gap", 1e6, "um"), ("gap", 1 / 0.0254, "inch"), ("current", 1e3, "mA"),
         ("voltage", 1e-3, "kV")],
    )  # fmt: skip
    def test_the_unit_that_would_fit_is_named(self, checked, topics, signal, factor, fits):
        columns = topics.columns()
        columns.values[signal][:] *= factor
        finding = only(checked(columns), "unit_suspect")
        assert finding.numbers["signal"] == signal
        assert finding.numbers["suggested"] == fits
        assert finding.severity == "error"

    def test_a_unit_that_is_declared_as_it_is_gives_no_finding(self, checked, topics):
        columns = topics.columns()
        columns.values["gap"][:] *= 1e3
        assert checked(columns, using=topics.map(gap=Signal(field="gap", unit="mm"))) == {}


class TestSpikes:
    @hypothesis_settings(deadline=None, max_examples=20)
    @given(
        at=st.sets(st.integers(1, 198), min_size=1, max_size=5),
        sign=st.sampled_from([-1, 1]),
        signal=st.sampled_from([("gap", 0.002), ("current", 5.0)]),
    )
    def test_single_values_that_jump_away_and_back_are_found(self, checked, topics, at, sign, signal):
        name, size = signal
        columns = topics.columns()
        places = [5 * k for k in sorted(at)]
        columns.values[name][places] += sign * size
        finding = checked(columns)["spikes"][0]
        assert messages_of(finding) == [(k, k) for k in places]
        assert finding.numbers["largest_jump"] == pytest.approx(size, rel=0.05)

    def test_a_step_is_none(self, checked, topics):
        columns = topics.columns()
        columns.values["gap"][500:] += 0.002
        assert checked(columns) == {}

    def test_a_value_beside_a_pause_is_none(self, checked, topics):
        columns = topics.columns()
        for times in (columns.publish_time_ns, columns.log_time_ns):
            times[500:] += 1500 * topics.ms
        for k in (499, 500):
            columns.values["current"][k] += 5
            assert "spikes" not in checked(columns)
            columns.values["current"][k] -= 5

    def test_the_crest_of_a_steep_swing_is_none(self, checked, topics):
        columns = topics.columns()
        columns.values["current"][496:505] += np.array([6, 9, 12, 14, 15, 14, 12, 9, 6])
        assert checked(columns) == {}

    def test_what_answers_to_a_step_of_the_set_point_is_none(self, checked, topics):
        columns = topics.columns()
        columns.values["current"][[300, 500]] += 5
        columns.values["set_point"] = np.where(np.arange(1000) < 500, 0.008, 0.007)
        finding = only(checked(columns, using=topics.map(set_point=Signal(field="set_point", unit="m"))), "spikes")
        assert messages_of(finding) == [(300, 300)]

    def test_a_spike_is_found_while_the_set_point_moves(self, checked, topics):
        columns = topics.columns()
        columns.values["current"][500] += 5
        columns.values["set_point"] = 0.008 + 1e-6 * np.arange(1000)
        finding = only(checked(columns, using=topics.map(set_point=Signal(field="set_point", unit="m"))), "spikes")
        assert messages_of(finding) == [(500, 500)]

    def test_where_the_plant_itself_may_jump_between_messages_nothing_is_said(self, checked, topics):
        columns = topics.columns(period_ms=100)
        columns.values["gap"][500] += 0.002
        assert "spikes" not in checked(columns)
