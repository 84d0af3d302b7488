"""With the real library, where it is installed: `make exports`. It wants gym, which warns on import."""

import warnings

import numpy as np
import pytest

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    d3rlpy = pytest.importorskip("d3rlpy")

pytestmark = pytest.mark.filterwarnings("default")
TINY = d3rlpy.models.VectorEncoderFactory([8, 8])


@pytest.fixture
def buffer(written):
    from d3rlpy.dataset import InfiniteBuffer, ReplayBuffer, load_v1

    with (written("d3rlpy") / "prefill.h5").open("rb") as file:
        return ReplayBuffer(InfiniteBuffer(), episodes=load_v1(file))


def test_rows_come_out_of_the_buffer_as_they_went_in(buffer, rows):
    assert buffer.transition_count == 100
    for row in range(100):
        one = buffer.transition_picker(*buffer.buffer[row])
        np.testing.assert_array_equal(one.observation, rows.observation[row])
        np.testing.assert_array_equal(one.action, rows.action[row])
        np.testing.assert_array_equal(one.reward, [rows.reward[row]])
        assert one.terminal == rows.terminated[row]
        assert one.interval == 1
        # d3rlpy has no next observation where an episode is terminated, and never looks at it.
        expected = np.zeros(3) if rows.terminated[row] else rows.next_observation[row]
        np.testing.assert_array_equal(one.next_observation, expected)


@pytest.mark.parametrize("kind", [d3rlpy.algos.DDPGConfig, d3rlpy.algos.TD3Config, d3rlpy.algos.TD3PlusBCConfig])
def test_it_trains_on_the_rows(buffer, kind):
    learner = kind(gamma=0.9, batch_size=32, actor_encoder_factory=TINY, critic_encoder_factory=TINY).create("cpu:0")
    told = learner.fit(
        buffer,
        n_steps=300,
        n_steps_per_epoch=100,
        logger_adapter=d3rlpy.logging.NoopAdapterFactory(),
        show_progress=False,
    )
    losses = [metrics["critic_loss"] for _, metrics in told]
    assert np.isfinite(losses).all()
    assert losses[-1] < losses[0]
    actions = learner.predict(np.zeros((2, 3), dtype=np.float32))
    assert (np.abs(actions) <= 1).all()
