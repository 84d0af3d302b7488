import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from maglev_offline.agents.roots import from_root, to_root

values = st.floats(-1e3, 1e3)
offsets = st.floats(1e-4, 1.0)


@settings(deadline=None)  # torch starts up in the first example
@given(value=values, offset=offsets)
def test_a_value_comes_back_from_its_root(value, offset):
    exact = torch.tensor(value, dtype=torch.float64)
    torch.testing.assert_close(from_root(to_root(exact, offset), offset), exact, atol=1e-9, rtol=1e-9)


@given(low=values, high=values, offset=offsets)
def test_the_order_of_values_is_kept(low, high, offset):
    """So the policy that is best under a value is best under its root."""
    low, high = sorted((low, high))
    roots = to_root(torch.tensor([low, high], dtype=torch.float64), offset)
    assert roots[0] <= roots[1]


def test_far_values_are_near_the_square_root_and_small_ones_nearly_linear():
    offset = 0.01
    far, small = to_root(torch.tensor([400.0, 1e-5], dtype=torch.float64), offset)
    assert abs(far - (20.0 - 0.1)) < 1e-3
    assert abs(small - 1e-5 / (2 * 0.1)) < 1e-7


def test_without_an_offset_the_critic_learns_the_cost_to_go_itself():
    value = torch.tensor([-2.0, 0.3])
    assert torch.equal(to_root(value, 0.0), value)
    assert torch.equal(from_root(value, 0.0), value)
