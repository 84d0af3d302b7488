"""The folder as it lies, and with the real library where it is installed: `make exports`."""

import json

import numpy as np
import pytest

from maglev_offline.errors import InputError
from maglev_offline.replay.exports.torchrl import steps_ahead


def test_a_tensor_is_a_file_of_its_numbers(written, rows):
    folder = written("torchrl") / "tensordict"
    about = json.loads((folder / "next/meta.json").read_text())
    assert about["reward"] == {"device": "cpu", "shape": [100, 1], "dtype": "torch.float32", "is_nested": False}
    assert about["done"]["dtype"] == "torch.bool"
    np.testing.assert_array_equal(np.fromfile(folder / "next/reward.memmap", np.float32), rows.reward)
    np.testing.assert_array_equal(np.fromfile(folder / "next/terminated.memmap", bool), rows.terminated)
    assert not (folder / "steps_to_next_obs.memmap").exists()


def test_a_row_that_spans_control_periods_says_how_many(semi_markov):
    np.testing.assert_array_equal(steps_ahead(semi_markov), np.where(semi_markov.terminated, 1, 10))


@pytest.mark.parametrize("discount", [0.9**1.5, 0.95, 1.0, 0.0])
def test_a_discount_that_is_no_power_of_gamma_is_refused(written, rows, discount):
    own = rows.discount.copy()
    own[2] = discount
    with pytest.raises(InputError, match=r"row 2, of the construction raw, .* no whole power of 0.9"):
        written("torchrl", rows._replace(discount=own))


def test_the_real_library_reads_the_rows_equal(written, rows):
    tensordict = pytest.importorskip("tensordict")
    found = tensordict.TensorDict.load_memmap(written("torchrl") / "tensordict")
    assert found.batch_size == (100,)
    np.testing.assert_array_equal(found["observation"], rows.observation)
    np.testing.assert_array_equal(found["action"], rows.action)
    np.testing.assert_array_equal(found["next", "observation"], rows.next_observation)
    np.testing.assert_array_equal(found["next", "reward"][:, 0], rows.reward)
    np.testing.assert_array_equal(found["next", "terminated"][:, 0], rows.terminated)
    np.testing.assert_array_equal(found["next", "truncated"][:, 0], ~rows.terminated)
    assert found["next", "done"].all()


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("spanning", [False, True], ids=["one period", "ten periods"])
def test_the_real_library_trains_ddpg_on_the_rows(written, rows, semi_markov, spanning):
    tensordict = pytest.importorskip("tensordict")
    pytest.importorskip("torchrl")
    import torch
    from tensordict.nn import TensorDictModule
    from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
    from torchrl.modules import ValueOperator
    from torchrl.objectives import DDPGLoss, ValueEstimators

    torch.manual_seed(0)
    these = semi_markov if spanning else rows
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(100), batch_size=32)
    buffer.extend(tensordict.TensorDict.load_memmap(written("torchrl", these) / "tensordict"))
    mlp = torch.nn.Sequential(torch.nn.Linear(3, 8), torch.nn.ReLU(), torch.nn.Linear(8, 1), torch.nn.Tanh())
    actor = TensorDictModule(mlp, in_keys=["observation"], out_keys=["action"])

    class Critic(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.net = torch.nn.Sequential(torch.nn.Linear(4, 8), torch.nn.ReLU(), torch.nn.Linear(8, 1))

        def forward(self, observation, action):
            return self.net(torch.cat([observation, action], -1))

    loss = DDPGLoss(actor, ValueOperator(Critic(), in_keys=["observation", "action"]))
    loss.make_value_estimator(ValueEstimators.TD0, gamma=0.9)
    moved = torch.optim.Adam(loss.parameters(), 1e-2)
    losses = []
    for _ in range(200):
        out = loss(buffer.sample())
        moved.zero_grad()
        (out["loss_actor"] + out["loss_value"]).backward()
        moved.step()
        losses.append(float(out["loss_value"].detach()))
    assert np.isfinite(losses).all()
    assert np.mean(losses[-20:]) < np.mean(losses[:20])
