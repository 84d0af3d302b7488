"""The clocks of a log against each other: late messages, drift, jumps, and stamps that cannot be."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_offline.ingest.settings import IngestSettings


def messages_of(finding):
    return [place.first_message for place in finding.places]


def test_late_messages_are_found_one_by_one(checked, topics):
    columns = topics.columns(1000)
    columns.log_time_ns[[100, 700]] += 30 * topics.ms
    order = np.argsort(columns.log_time_ns, kind="stable")
    found = checked(columns.take(order))
    assert list(found) == ["late_messages"]
    finding = found["late_messages"][0]
    assert [int(order[k]) for k in messages_of(finding)] == [100, 700]
    assert finding.numbers["largest_delay_ms"] == pytest.approx(30.5)


def test_a_message_under_way_while_all_clocks_are_reset_is_not_early(checked, topics):
    columns = topics.columns(1000)
    true_log = columns.log_time_ns.copy()
    true_log[498] += 35 * topics.ms  # late, and across the reset
    reset_ns = columns.publish_time_ns[500]
    order = np.argsort(true_log, kind="stable")
    back = 2000 * topics.ms
    columns.log_time_ns[:] = true_log - back * (true_log >= reset_ns)
    columns.publish_time_ns[500:] -= back
    found = checked(columns.take(order))
    assert "logged_before_published" not in found
    assert [int(order[k]) for k in messages_of(found["late_messages"][0])] == [498]
    assert "clock_jump" not in found


@pytest.mark.parametrize("clock", ["publish_time", "log_time"])
def test_it_may_be_late_by_many_messages(checked, topics, clock):
    columns = topics.columns(1000)
    true_log = columns.log_time_ns.copy()
    true_log[498] += 300 * topics.ms
    reset_ns = columns.publish_time_ns[500]
    order = np.argsort(true_log, kind="stable")
    back = 2000 * topics.ms
    columns.log_time_ns[:] = true_log - back * (true_log >= reset_ns)
    columns.publish_time_ns[500:] -= back
    ingest = IngestSettings(grid_ms=10, longest_bridge_ms=25, reorder_ms=400)
    found = checked(columns.take(order), using=topics.map(clock=clock), ingest=ingest)
    assert "logged_before_published" not in found
    assert [int(order[k]) for k in messages_of(found["late_messages"][0])] == [498]


def test_a_usual_delay_of_most_of_a_period_is_told(checked, topics):
    columns = topics.columns(1000)
    columns.log_time_ns[:] += 7 * topics.ms
    found = checked(columns)
    assert list(found) == ["latency"]
    assert found["latency"][0].numbers["usual_delay_ms"] == pytest.approx(7.5)


def test_messages_recorded_before_they_were_sent_are_told(checked, topics):
    columns = topics.columns(1000)
    columns.log_time_ns[300:303] -= 3 * topics.ms
    found = checked(columns)
    assert list(found) == ["logged_before_published"]
    assert messages_of(found["logged_before_published"][0]) == [300, 301, 302]


@pytest.mark.parametrize("ppm", [-400, 200, 20_000])
def test_a_drift_is_measured(checked, topics, ppm):
    columns = topics.columns(6000)
    away = (columns.publish_time_ns - topics.t0) * (ppm * 1e-6)
    columns.log_time_ns[:] += away.astype(np.int64) + (100 * topics.ms if ppm < 0 else 0)
    finding = checked(columns)["clock_drift"][0]
    assert finding.numbers["drift_ppm"] == pytest.approx(ppm, rel=0.02)
    assert finding.numbers["clocks"] == "log time and publish time"


def test_scatter_of_the_delay_is_no_drift(checked, topics):
    columns = topics.columns(3000)
    columns.log_time_ns[:] += np.random.default_rng(0).gamma(2, 0.5 * topics.ms, 3000).astype(np.int64)
    assert checked(columns) == {}


@pytest.mark.parametrize("at", [333, 1500, 2750])
@pytest.mark.parametrize("jump_ms", [80, -80])
def test_a_clock_that_was_set_is_found_where_it_was_set(checked, topics, at, jump_ms):
    columns = topics.columns(3000)
    columns.log_time_ns[at:] += jump_ms * topics.ms
    columns.log_time_ns[:] += 100 * topics.ms
    finding = checked(columns)["clock_jump"][0]
    assert finding.count == 1
    assert finding.places[0].last_message == at
    assert finding.numbers["largest_jump_ms"] == pytest.approx(80)


def test_the_stamp_in_the_messages_is_held_against_the_publish_time(checked, topics):
    columns = topics.columns(6000)
    stamp = columns.publish_time_ns + ((columns.publish_time_ns - topics.t0) * 3e-4).astype(np.int64)
    found = checked(replace(columns, clock_ns=stamp))
    assert list(found) == ["clock_drift"]
    assert found["clock_drift"][0].numbers["clocks"] == "publish time and header stamp"
    assert found["clock_drift"][0].numbers["drift_ppm"] == pytest.approx(-300, rel=0.02)


def test_without_a_publish_time_there_is_no_delay(checked, topics):
    columns = topics.columns(1000)
    columns.publish_time_ns[:] = 0
    assert checked(columns) == {}
