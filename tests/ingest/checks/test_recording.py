"""Defects of the recording, put in at known messages, are found there; a clean topic gives none."""

import numpy as np
import pytest

from maglev_offline.ingest.checks import CheckSettings
from maglev_offline.ingest.settings import IngestSettings
from maglev_offline.logs.signals import Signal


def messages_of(finding):
    """First and last message of each place."""
    return [(place.first_message, place.last_message) for place in finding.places]


@pytest.mark.parametrize("seed", range(10))
def test_a_clean_topic_gives_no_finding(checked, topics, seed):
    assert checked(topics.columns(seed=seed)) == {}


@pytest.mark.parametrize("n", range(5))
def test_a_topic_of_next_to_no_messages_gives_no_finding(checked, topics, n):
    assert checked(topics.columns(n)) == {}


def test_places_count_from_the_window_that_the_messages_came_in(checked, topics):
    columns = topics.columns(100).take(np.delete(np.arange(100), 40))
    found = checked(columns, message=np.arange(500, 599))
    assert messages_of(found["dropped_messages"][0]) == [(539, 540)]


class TestLedger:
    def test_what_cannot_be_decoded_is_told_in_runs(self, checked, topics):
        decoded = np.ones(100, dtype=np.bool_)
        decoded[[10, 11, 12, 50]] = False
        finding = checked(topics.columns(100, decoded=decoded))["not_decodable"][0]
        assert messages_of(finding) == [(10, 12), (50, 50)]
        assert finding.count == 4
        assert finding.numbers["share"] == 0.04
        assert finding.severity == "error"

    def test_values_that_are_nan_are_told_by_signal(self, checked, topics):
        columns = topics.columns(100)
        columns.values["gap"][20:23] = np.nan
        columns.values["current"][60] = np.inf
        found = {f.numbers["signal"]: f for f in checked(columns)["not_finite"]}
        assert messages_of(found["gap"]) == [(20, 22)]
        assert messages_of(found["current"]) == [(60, 60)]
        assert {f.about for f in found.values()} == {"signal"}

    def test_a_conflict_of_times_is_told(self, checked, topics):
        columns = topics.columns(100)
        columns.publish_time_ns[30] = columns.publish_time_ns[29]
        assert messages_of(checked(columns)["time_conflict"][0]) == [(30, 30)]


class TestRepeats:
    def twice(self, topics, log_time_lag_ns):
        columns = topics.columns(100).take(np.insert(np.arange(100), 51, 50))
        columns.log_time_ns[51] += log_time_lag_ns
        return columns

    def test_a_repeated_message_is_told_and_nothing_else(self, checked, topics):
        found = checked(self.twice(topics, 1))
        assert list(found) == ["repeated_messages"]
        assert messages_of(found["repeated_messages"][0]) == [(51, 51)]

    def test_it_is_told_under_a_clock_that_tells_the_two_apart(self, checked, topics):
        found = checked(self.twice(topics, topics.ms), using=topics.map(clock="log_time"))
        assert messages_of(found["repeated_messages"][0]) == [(51, 51)]

    @pytest.mark.parametrize("clock", ["publish_time", "log_time"])
    def test_the_number_and_the_time_of_another_with_other_values_is_none(self, checked, topics, clock):
        columns = self.twice(topics, topics.ms)
        columns.values["gap"][51] += 1e-5
        assert "repeated_messages" not in checked(columns, using=topics.map(clock=clock))


class TestOrder:
    def test_a_reset_is_told_with_the_way_back(self, checked, topics):
        columns = topics.columns()
        for times in (columns.log_time_ns, columns.publish_time_ns):
            times[600:] -= 4000 * topics.ms
        found = checked(columns)
        assert list(found) == ["clock_reset"]
        finding = found["clock_reset"][0]
        assert messages_of(finding) == [(599, 600)]
        assert finding.numbers["largest_back_s"] == pytest.approx(3.99)

    def test_messages_that_lie_in_the_file_after_younger_ones_are_told(self, checked, topics):
        order = np.arange(100)
        order[[40, 41, 42]] = [41, 42, 40]
        columns = topics.columns(100).take(order)
        columns.log_time_ns[:] = columns.publish_time_ns
        found = checked(columns)
        assert list(found) == ["out_of_order"]
        assert messages_of(found["out_of_order"][0]) == [(42, 42)]
        assert found["out_of_order"][0].numbers["largest_back_ms"] == 20

    def test_a_clock_that_stands_is_told(self, checked, topics):
        columns = topics.columns()
        columns.publish_time_ns[300:308] = columns.publish_time_ns[300]
        finding = checked(columns)["clock_frozen"][0]
        assert messages_of(finding) == [(300, 307)]
        assert finding.numbers["largest_messages"] == 8


class TestRate:
    def test_another_rate_than_declared_is_told(self, checked, topics):
        found = checked(topics.columns(), settings=CheckSettings(declared_period_ms=20))
        assert found["rate_not_declared"][0].numbers["period_ms"] == 10
        assert checked(topics.columns(), settings=CheckSettings(declared_period_ms=10)) == {}

    @pytest.mark.parametrize(("grid_ms", "code"), [(5, "slower_than_grid"), (20, "faster_than_grid")])
    def test_a_grid_that_does_not_fit_is_told(self, checked, topics, grid_ms, code):
        ingest = IngestSettings(grid_ms=grid_ms, longest_bridge_ms=25)
        assert list(checked(topics.columns(), ingest=ingest)) == [code]

    @pytest.mark.parametrize(("jitter_ms", "severity"), [(0.5, "info"), (1.5, "warning")])
    def test_jitter_is_told_with_its_size(self, checked, topics, jitter_ms, severity):
        columns = topics.columns(5000)
        shift = np.random.default_rng(1).normal(size=5000).clip(-2, 2) * jitter_ms * topics.ms
        columns.publish_time_ns[:] += shift.astype(np.int64)
        columns.log_time_ns[:] = columns.publish_time_ns
        found = checked(columns)
        assert list(found) == ["jitter"]
        assert found["jitter"][0].severity == severity
        assert found["jitter"][0].numbers["jitter_ms"] == pytest.approx(2**0.5 * jitter_ms, rel=0.15)


class TestSeams:
    def joined(self, topics, later_ms, *, restart=True, jump=True):
        a, b = topics.columns(400), topics.columns(300, seed=5)
        b.publish_time_ns[:] = a.publish_time_ns[-1] + later_ms * topics.ms + np.arange(300) * 10 * topics.ms
        b.log_time_ns[:] = b.publish_time_ns + topics.ms // 2
        for name in b.values:
            b.values[name][:] += a.values[name][-1] - b.values[name][0] + (0.003 if jump and name == "gap" else 0)
        if not restart:
            b.sequence[:] += 400
        return a.remade([np.concatenate(x) for x in zip(a.arrays(), b.arrays(), strict=True)])

    @pytest.mark.parametrize("later_ms", [5000, -2000])
    def test_a_place_where_numbers_restart_and_time_jumps_is_a_seam(self, checked, topics, later_ms):
        finding = checked(self.joined(topics, later_ms))["seam"][0]
        assert messages_of(finding) == [(399, 400)]
        assert "sequence numbers restart" in finding.numbers["signs"]
        assert "gap jump" in finding.numbers["signs"]

    def test_numbers_that_restart_alone_are_none(self, checked, topics):
        assert checked(self.joined(topics, 10, jump=False)) == {}

    @pytest.mark.parametrize("steps", [0, 1])
    def test_a_set_point_that_hardly_ever_steps_jumps_by_any_step(self, checked, topics, steps):
        columns = self.joined(topics, 10, jump=False)
        set_point = np.full(len(columns), 0.008)
        set_point[400:] = 0.009
        set_point[100 : 100 + 50 * steps] = 0.010
        columns.values["set_point"] = set_point
        using = topics.map(set_point=Signal(field="set_point", unit="m"))
        assert "set_point jump" in checked(columns, using=using)["seam"][0].numbers["signs"]
        set_point[400:] = 0.008
        assert "seam" not in checked(columns, using=using)

    def test_the_next_level_of_a_coarse_signal_is_no_jump(self, checked, topics):
        columns = self.joined(topics, 10, jump=False)
        gap = columns.values["gap"]
        gap[:] = np.rint((gap - gap[399]) / 2.5e-4) * 2.5e-4 + 0.008
        gap[395:400], gap[400:405] = 0.008, 0.00825
        assert "seam" not in checked(columns)

    def test_a_reset_alone_is_none(self, checked, topics):
        assert set(checked(self.joined(topics, -2000, restart=False))) == {"clock_reset"}
