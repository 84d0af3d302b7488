import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.curate.balance.draw import weighted_draw

weights = st.lists(st.floats(1e-300, 1e6), min_size=1, max_size=60).map(np.array)


@given(weights, st.integers(1, 80), st.integers(0, 50))
@settings(max_examples=40)
def test_a_draw_has_as_many_different_rows_as_asked_for_or_all_of_them(weight, count, seed):
    chosen = weighted_draw(weight, count, np.random.default_rng(seed))
    assert len(chosen) == min(count, len(weight))
    assert (np.diff(chosen) > 0).all()
    np.testing.assert_array_equal(chosen, weighted_draw(weight, count, np.random.default_rng(seed)))


def test_a_row_is_drawn_in_proportion_to_its_weight():
    rng = np.random.default_rng(0)
    first = [weighted_draw(np.array([1.0, 2.0, 5.0]), 1, rng)[0] for _ in range(4000)]
    np.testing.assert_allclose(np.bincount(first) / 4000, [1 / 8, 2 / 8, 5 / 8], atol=0.03)


def test_the_second_row_is_drawn_in_proportion_to_what_is_left():
    rng = np.random.default_rng(0)
    missing = [3 - weighted_draw(np.array([1.0, 2.0, 5.0]), 2, rng).sum() for _ in range(4000)]
    # Row 2 is missing where 0 and 1 come, in either order: 1/8 * 2/7 + 2/8 * 1/6.
    np.testing.assert_allclose(np.mean(np.array(missing) == 2), 1 / 8 * 2 / 7 + 2 / 8 * 1 / 6, atol=0.02)
