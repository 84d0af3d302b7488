import pytest
import torch

from maglev_offline.agents.adam import Adam


@pytest.mark.parametrize("steps", [1, 2, 30])
def test_it_steps_as_torchs_own_adam_does(steps):
    generator = torch.Generator().manual_seed(0)
    start = {"w1": torch.randn(3, 4, 5, generator=generator), "b1": torch.randn(3, 1, 5, generator=generator)}
    ours = {name: value.clone().requires_grad_() for name, value in start.items()}
    theirs = [value.clone().requires_grad_() for value in start.values()]
    adam, reference = Adam(ours, 1e-2), torch.optim.Adam(theirs, lr=1e-2)
    for step in range(steps):
        adam.learning_rate = reference.param_groups[0]["lr"] = 1e-2 / (1 + step)
        adam.descend(sum((value.square() * value).sum() for value in ours.values()))
        reference.zero_grad()
        sum((value.square() * value).sum() for value in theirs).backward()
        reference.step()
    for value, expected in zip(ours.values(), theirs, strict=True):
        torch.testing.assert_close(value, expected)
    assert int(adam.steps) == steps


def test_running_statistics_are_no_parameters():
    net = {"w1": torch.ones(2).requires_grad_(), "mean_1": torch.zeros(2), "var_1": torch.ones(2)}
    adam = Adam(net, 1e-3)
    adam.descend(net["w1"].sum())
    assert list(adam.parameters) == list(adam.mean) == ["w1"]
    assert torch.equal(net["mean_1"], torch.zeros(2))
