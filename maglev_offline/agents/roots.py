"""Critics that learn the root of the cost-to-go: z = h(q) = sign(q) (sqrt(|q| + e) - sqrt(e)), and back.

The cost is quadratic, so its values span five powers of ten between the end of the gap and the set-point; a critic of
the values themselves spends itself on the far states, and its errors near the set-point are the policy's bias. The root
is nearly linear in the distance, which layers of ReLUs follow at every scale. The policy that is best under q is best
under h(q), and where the next state is certain the Bellman equation keeps its solution, as for the squashed values of
Pohlen et al. (2018). `e`, in units of the cost, rounds the tip of the cone; 0 stands for no root at all.
"""

from torch import Tensor


def to_root(values: Tensor, offset: float) -> Tensor:
    """h: costs-to-go as the critics put them out."""
    return values.sign() * ((values.abs() + offset).sqrt() - offset**0.5) if offset else values


def from_root(roots: Tensor, offset: float) -> Tensor:
    """The inverse of h: what the critics put out as costs-to-go."""
    return roots * (roots.abs() + 2 * offset**0.5) if offset else roots
