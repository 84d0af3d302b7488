import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.ingest.velocity import central_differences


def test_a_parabola_is_exact_inside_and_one_sided_at_the_ends():
    t = np.arange(5) * 0.1
    found = central_differences(3 * t**2, np.zeros(5, np.int64), 0.1)
    np.testing.assert_allclose(found[1:-1], 6 * t[1:-1])
    np.testing.assert_allclose(found[[0, -1]], [0.3, 2.1])


def test_segments_do_not_see_each_other():
    found = central_differences(np.array([0.0, 1, 10, 12, 5]), np.array([0, 0, 1, 1, 2]), 1.0)
    np.testing.assert_array_equal(found, [1, 1, 2, 2, np.nan])


@given(st.lists(st.lists(st.floats(-1, 1), min_size=2, max_size=9), min_size=1, max_size=5))
def test_each_segment_is_differentiated_as_numpy_does(segments):
    gap = np.concatenate([np.array(s) for s in segments])
    number = np.repeat(np.arange(len(segments)), [len(s) for s in segments])
    expected = np.concatenate([np.gradient(np.array(s), 0.01) for s in segments])
    np.testing.assert_allclose(central_differences(gap, number, 0.01), expected, atol=1e-12)


def test_at_100_ms_a_loop_of_3_rad_per_sample_is_damped_to_nothing():
    angle = 3.0 * np.arange(200)
    found = central_differences(np.sin(angle), np.zeros(200, np.int64), 0.1)
    assert np.abs(found[1:-1]).max() < 0.05 * (3.0 / 0.1)


def test_nothing_of_nothing():
    assert len(central_differences(np.empty(0), np.empty(0, np.int64), 0.1)) == 0
