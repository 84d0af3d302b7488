import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.replay.sampling import Mixture, places

JUST_BELOW_1 = np.nextafter(1.0, 0.0)
UNIFORM = np.random.default_rng(0).random((4, 5000))

counts = st.integers(0, 500)
mixtures = st.builds(Mixture, st.none() | st.floats(0, 1), st.none() | st.integers(1, 1000))


@given(counts, counts, mixtures, st.integers(0, 2000))
def test_every_draw_from_0_to_just_below_1_meets_a_filled_slot(prefilled, own, mixture, step):
    if not prefilled + own:
        return
    slots = places(np.array([0.0, 0.25, 0.5, 0.75, JUST_BELOW_1]), prefilled, own, mixture, step)
    assert slots.min() >= 0
    assert slots.max() < prefilled + own


@given(counts, counts)
def test_without_a_share_and_a_decay_every_filled_slot_is_as_likely_as_any_other(prefilled, own):
    slots = places(UNIFORM, prefilled, own, Mixture(), 7)
    np.testing.assert_array_equal(slots, np.floor(UNIFORM * (prefilled + own)))


@pytest.mark.parametrize(("step", "weight"), [(0, 1.0), (25, 0.75), (99, 0.01), (100, 0.0), (5000, 0.0)])
def test_the_prefills_weight_falls_linearly_to_nothing(step, weight):
    mixture = Mixture(decay_steps=100)
    assert mixture.weight(step) == pytest.approx(weight)
    slots = places(UNIFORM, 300, 100, mixture, step)
    assert (slots < 300).mean() == pytest.approx(weight * 300 / (weight * 300 + 100), abs=0.01)


def test_what_a_decaying_prefill_gives_up_goes_evenly_to_the_agents_own_rows():
    slots = places((np.arange(3000) + 0.5) / 3000, 10, 10, Mixture(decay_steps=100), 50)
    np.testing.assert_array_equal(np.bincount(slots), np.repeat([100, 200], 10))


@pytest.mark.parametrize(("share", "batch", "prefilled_places"), [(0.5, 100, 50), (0.25, 10, 2), (1, 8, 8), (0, 8, 0)])
def test_a_share_is_kept_in_every_batch_whatever_the_buffer_holds(share, batch, prefilled_places):
    for own in (1, 10, 10_000):
        slots = places(UNIFORM[:, :batch], 300, own, Mixture(share), 0)
        assert ((slots < 300).sum(axis=1) == prefilled_places).all()
        assert (slots[:, :prefilled_places] < 300).all()


def test_a_share_decays_too():
    slots = places(UNIFORM[:, :100], 300, 50, Mixture(0.5, 100), 80)
    assert ((slots < 300).sum(axis=1) == 10).all()


@pytest.mark.parametrize("mixture", [Mixture(), Mixture(0.5), Mixture(decay_steps=10), Mixture(0.5, 10)])
def test_where_one_side_is_empty_all_come_from_the_other(mixture):
    for step in (0, 5, 50):
        np.testing.assert_array_equal(places(UNIFORM, 0, 7, mixture, step), np.floor(UNIFORM * 7))
        np.testing.assert_array_equal(places(UNIFORM, 7, 0, mixture, step), np.floor(UNIFORM * 7))
