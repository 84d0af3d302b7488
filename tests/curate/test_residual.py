from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from maglev_offline.curate import residual
from maglev_offline.curate.residual import predicted, recording_of, windows_of
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

PLANT, MDP = Plant(), Mdp()


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_the_simulator_foretells_its_own_samples_with_the_voltage_on_a_line_between(driven_samples, steps):
    windows = windows_of(recording_of(driven_samples()), steps, 0)
    assert len(windows) == 40 * (6 - steps)
    np.testing.assert_allclose(windows.duration_s, 0.005)
    np.testing.assert_allclose(predicted(windows, PLANT, MDP), windows.later, atol=1e-9)
    assert np.abs(windows.later - windows.state).max() > 1e-2


def test_a_window_lies_in_one_segment_finite_and_out_of_contact(samples_of):
    samples = pd.concat([samples_of([0.008] * 6), samples_of([0.009] * 4, segment=1)], ignore_index=True)
    assert len(windows_of(recording_of(samples), 2, 0)) == 4 + 2
    samples.loc[2, "gap_m"] = np.nan
    samples.loc[9, "contact"] = True
    assert windows_of(recording_of(samples), 2, 0).place[["segment", "step"]].to_numpy().tolist() == [[0, 3], [1, 0]]
    samples.loc[7, "voltage_v"] = np.inf
    assert len(windows_of(recording_of(samples), 1, 0)) == 3
    assert len(windows_of(recording_of(samples), 8, 0)) == 0


def test_no_window_reaches_over_samples_that_were_not_drawn(samples_of):
    samples = samples_of([0.008] * 10).drop(index=[4]).reset_index(drop=True)
    found = windows_of(recording_of(samples), 2, 0)
    assert found.place["step"].tolist() == [0, 1, 5, 6, 7]
    np.testing.assert_allclose(found.duration_s, 0.1)


def test_the_order_of_the_samples_does_not_matter(driven_samples):
    samples = driven_samples()
    first, second = (
        windows_of(recording_of(table), 2, 0) for table in (samples, samples.sample(frac=1, random_state=1))
    )
    pd.testing.assert_frame_equal(first.place, second.place)
    np.testing.assert_array_equal(first.state, second.state)


def test_of_many_windows_the_seed_chooses_some_and_of_long_ones_fewer(driven_samples, monkeypatch):
    monkeypatch.setattr(residual, "MOST_WINDOWS", 50)
    samples = driven_samples()
    first, again, other = (windows_of(recording_of(samples), 1, seed) for seed in (0, 0, 1))
    assert len(first) == len(other) == 50
    assert first.place.equals(again.place)
    assert not first.place.equals(other.place)
    assert len(windows_of(recording_of(samples), 5, 0)) == 10


def test_windows_may_last_differently(driven_samples):
    samples = driven_samples()
    short, both = windows_of(recording_of(samples), 1, 0), windows_of(recording_of(samples), 1, 0)
    stretched = np.where(np.arange(len(both)) % 2 == 0, 1.0, 0.5)[:, None]
    both = replace(both, duration_s=both.duration_s * stretched)
    same = stretched[:, 0] == 1.0
    np.testing.assert_array_equal(predicted(both, PLANT, MDP)[same], predicted(short, PLANT, MDP)[same])
