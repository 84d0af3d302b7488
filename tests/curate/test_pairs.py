import numpy as np
import pandas as pd

from maglev_offline.curate.pairs import pairs_of
from maglev_offline.physics.parameters import Plant

PLANT = Plant()


def test_a_pair_holds_both_samples_about_the_set_point_of_the_first(samples_of):
    pairs = pairs_of(
        samples_of([0.007, 0.009, 0.010], voltage_v=[20, 25, 30], set_point_m=[0.008, 0.009, 0.009]), PLANT
    )
    assert len(pairs) == 2
    rest = np.array([PLANT.equilibrium(gap).voltage_v for gap in (0.008, 0.009)])
    np.testing.assert_allclose(pairs.state[:, 0], [-0.001, 0], atol=1e-15)
    np.testing.assert_allclose(pairs.next_state[:, 0], [0.001, 0.001], atol=1e-15)
    np.testing.assert_allclose(pairs.voltage_v, np.array([20, 25]) - rest)
    np.testing.assert_allclose(pairs.next_voltage_v, np.array([25, 30]) - rest)
    np.testing.assert_allclose(pairs.duration_s, 0.1)


def test_a_pair_knows_whether_it_ends_its_segment_or_in_contact(samples_of):
    one = samples_of([0.012, 0.014, 0.016], contact=[False, False, True])
    pairs = pairs_of(pd.concat([one, samples_of([0.008] * 2, segment=1)]), PLANT)
    assert pairs.last.tolist() == [False, True, True]
    assert pairs.touches.tolist() == [False, True, False]


def test_a_velocity_is_logged_where_neither_end_was_made_from_gaps(samples_of):
    samples = samples_of([0.008] * 4)
    samples["gap_velocity_origin"] = ["measured", "interpolated", "reconstructed", "measured"]
    assert pairs_of(samples, PLANT).velocity_logged.tolist() == [True, False, False]


def test_lone_samples_make_no_pair(samples_of):
    assert len(pairs_of(samples_of([0.008]), PLANT)) == 0
