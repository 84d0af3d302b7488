import numpy as np


def test_the_arrays_are_the_rows_under_the_names_of_d4rl(written, rows):
    with np.load(written("npz") / "prefill.npz", allow_pickle=False) as found:
        assert {name: found[name].shape for name in found} == {
            "observations": (100, 3),
            "actions": (100, 1),
            "rewards": (100,),
            "next_observations": (100, 3),
            "terminals": (100,),
            "timeouts": (100,),
            "discounts": (100,),
        }
        np.testing.assert_array_equal(found["observations"], rows.observation)
        np.testing.assert_array_equal(found["actions"], rows.action)
        np.testing.assert_array_equal(found["rewards"], rows.reward)
        np.testing.assert_array_equal(found["next_observations"], rows.next_observation)
        np.testing.assert_array_equal(found["terminals"], rows.terminated)
        np.testing.assert_array_equal(found["timeouts"], ~rows.terminated)
        np.testing.assert_array_equal(found["discounts"], rows.discount)


def test_discounts_of_the_rows_own_are_kept(written, semi_markov):
    with np.load(written("npz", semi_markov) / "prefill.npz") as found:
        np.testing.assert_array_equal(found["discounts"], semi_markov.discount)
