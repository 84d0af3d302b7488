import numpy as np

from maglev_offline.ingest import rules

NAN = np.nan


def test_a_state_signal_that_is_not_finite_disqualifies_its_message():
    found = rules.not_finite({"gap": np.array([1, NAN, 1]), "current": np.array([1, 1, np.inf])})
    assert {name: mask.tolist() for name, mask in found.items()} == {
        "gap": [False, True, False],
        "current": [False, False, True],
    }


def test_a_context_signal_alone_does_not():
    assert list(rules.not_finite({"gap": np.ones(2), "load_kg": np.array([NAN, 1])})) == ["gap"]


def test_a_message_of_context_alone_needs_one_finite_value():
    found = rules.not_finite({"load_kg": np.array([NAN, NAN]), "speed_m_s": np.array([NAN, 1])})
    assert found["load_kg"].tolist() == [True, False]


def test_same_time_same_values_is_a_repeat_and_other_values_a_conflict():
    t = np.array([0, 10, 10, 10, 20])
    repeated, conflict = rules.same_time(t, np.zeros(5, np.int32), {"gap": np.array([1.0, 2, 2, 3, 3])})
    assert repeated.tolist() == [False, False, True, False, False]
    assert conflict.tolist() == [False, False, False, True, False]


def test_not_a_number_repeats_itself():
    repeated, _ = rules.same_time(np.array([0, 0]), np.zeros(2, np.int32), {"load_kg": np.array([NAN, NAN])})
    assert repeated.tolist() == [False, True]


def test_the_same_time_in_another_epoch_is_no_repeat():
    repeated, conflict = rules.same_time(np.array([5, 5]), np.array([0, 1], np.int32), {"gap": np.ones(2)})
    assert not repeated.any()
    assert not conflict.any()


def test_details_name_the_signals():
    masks = {"gap": np.array([True, False, True]), "voltage": np.array([True, False, False])}
    assert rules.named(masks, 3).tolist() == ["gap, voltage", "", "gap"]
