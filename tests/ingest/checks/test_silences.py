"""Missing messages are found in their gaps, with sequence numbers and without; pauses are told from holes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from maglev_offline.ingest.checks import CheckSettings

MOST_DROPPED = CheckSettings().most_dropped


def without(topics, gone, *, numbered=True, n=400):
    columns = topics.columns(n)
    if not numbered:
        columns.sequence[:] = 0
    return columns.take(np.setdiff1d(np.arange(n), gone))


def missing_of(found):
    """Sequence numbers that a finding says are missing, when nothing else is wrong with the topic."""
    return found["dropped_messages"][0].numbers["missing"] if "dropped_messages" in found else 0


@pytest.mark.parametrize("numbered", [True, False])
def test_a_dropped_message_is_found_between_its_neighbours(checked, topics, numbered):
    found = checked(without(topics, [100], numbered=numbered))
    assert list(found) == ["dropped_messages"]
    finding = found["dropped_messages"][0]
    place = finding.places[0]
    assert (place.first_message, place.last_message) == (99, 100)
    assert (place.start_ns, place.end_ns) == (topics.t0 + 990 * topics.ms, topics.t0 + 1010 * topics.ms)
    assert (finding.numbers["missing"], finding.numbers["of"]) == (1, 400)
    assert finding.numbers["by"] == ("sequence numbers" if numbered else "period")


@pytest.mark.parametrize("numbered", [True, False])
def test_a_hole_is_a_silence_over_the_bridge(checked, topics, numbered):
    found = checked(without(topics, np.arange(200, 300), numbered=numbered))
    assert list(found) == ["hole"]
    place = found["hole"][0].places[0]
    assert (place.first_message, place.last_message) == (199, 200)
    assert found["hole"][0].numbers["longest_s"] == pytest.approx(1.01)


def test_a_silence_in_which_no_number_is_missing_is_a_pause(checked, topics):
    columns = topics.columns(400)
    for times in (columns.publish_time_ns, columns.log_time_ns):
        times[200:] += 1500 * topics.ms
    found = checked(columns)
    assert list(found) == ["pause"]
    assert found["pause"][0].severity == "info"
    assert found["pause"][0].places[0].last_message == 200


def test_a_message_dropped_beside_a_pause_is_found_as_well(checked, topics):
    columns = topics.columns(400)
    for times in (columns.publish_time_ns, columns.log_time_ns):
        times[200:] += 1500 * topics.ms
    found = checked(columns.take(np.delete(np.arange(400), 200)))
    assert sorted(found) == ["dropped_messages", "pause"]
    assert missing_of(found) == 1


def test_numbers_that_do_not_count_the_messages_are_not_used(checked, topics):
    columns = topics.columns(400)
    columns.sequence[:] *= 3  # shared with two other topics
    assert checked(columns) == {}


def test_a_topic_without_a_regular_period_and_numbers_says_nothing_of_drops(checked, topics):
    columns = topics.columns(400)
    steps = np.random.default_rng(2).choice([10, 20], 400) * topics.ms
    columns.publish_time_ns[:] = topics.t0 + np.cumsum(steps)
    columns.log_time_ns[:] = columns.publish_time_ns
    columns.sequence[:] = 0
    assert "dropped_messages" not in checked(columns)


@hypothesis_settings(deadline=None, max_examples=40)
@given(gone=st.sets(st.integers(1, 298), max_size=60), late=st.booleans())
def test_every_missing_number_lies_in_a_gap_that_is_told(checked, topics, gone, late):
    columns = without(topics, sorted(gone), n=300)
    if late:  # the order of the file has nothing to do with what is missing
        order = np.arange(len(columns))
        order[[10, 11]] = order[[11, 10]]
        columns = columns.take(order)
    found = checked(columns)
    runs = np.split(np.array(sorted(gone)), np.flatnonzero(np.diff(sorted(gone)) != 1) + 1) if gone else []
    assert missing_of(found) == sum(len(run) for run in runs if len(run) <= MOST_DROPPED)
    long = [run for run in runs if (len(run) + 1) * 10 > 25]
    assert sum(f.count for f in found.get("hole", [])) == len(long)
