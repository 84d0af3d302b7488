import numpy as np

from maglev_offline.agents.draws import DrawStreams


def streams(seeds, force_std_n=0.0, smoothed=True):
    return DrawStreams(seeds, batch_size=4, plant_steps=3, force_std_n=force_std_n, smoothed=smoothed)


def joined(parts):
    return [np.concatenate(columns) for columns in zip(*[part[:-1] for part in parts], strict=True)]


def test_a_stream_gives_the_same_numbers_in_any_chunks():
    whole = streams([0, 1]).draw(10)
    split = streams([0, 1])
    for one, other in zip(joined([whole]), joined([split.draw(3), split.draw(7)]), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_seed_draws_the_same_whatever_seeds_are_beside_it():
    together, alone = streams([3, 4, 5]).draw(6), streams([4]).draw(6)
    for one, other in zip(together[:-1], alone[:-1], strict=True):
        np.testing.assert_array_equal(one[:, 1], other[:, 0])


def test_without_smoothing_none_is_drawn_and_the_rest_stays():
    with_it, without = streams([3, 4]).draw(6), streams([3, 4], smoothed=False).draw(6)
    assert without.smoothing.shape == (6, 2, 0)
    for name in ("start", "exploration", "uniform_action", "batch"):
        np.testing.assert_array_equal(getattr(with_it, name), getattr(without, name))


def test_the_purposes_are_independent_streams():
    draws = streams([0]).draw(1000)
    assert abs(np.corrcoef(draws.start[:, 0], draws.uniform_action[:, 0])[0, 1]) < 0.1


def test_force_noise_has_one_value_for_each_plant_step_and_seed():
    draws = streams([0, 1], force_std_n=500.0).draw(400)
    assert draws.force.shape == (400, 3, 2)
    assert abs(draws.force.std() - 500) < 25
    assert streams([0, 1]).draw(2).force is None


def test_streams_go_on_where_their_state_was_taken():
    one, other = streams([0, 1], force_std_n=10.0), streams([0, 1], force_std_n=10.0)
    one.draw(13)
    state = one.state()
    assert state.dtype == np.uint64
    assert state.shape == (6, 2, 4)
    expected = one.draw(7)
    other.restore(state)
    for a, b in zip(expected, other.draw(7), strict=True):
        np.testing.assert_array_equal(a, b)
