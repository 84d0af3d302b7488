"""Which rows a batch takes: from uniform draws to slots, with the prefill's share of the batch."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Mixture(NamedTuple):
    """How much of a batch comes from the prefill.

    `share` None: every filled slot is as likely as any other, a prefilled one by its weight. `share` s: the first
    round(batch s weight) places of a batch are prefilled rows, the others the agent's own. The weight falls linearly
    from 1 to 0 over the first `decay_steps` steps; it stays 1 where that is None.
    """

    share: float | None = None
    decay_steps: int | None = None

    def weight(self, step: int) -> float:
        """Weight of a prefilled row against one of the agent's own, in [0, 1]."""
        return 1.0 if self.decay_steps is None else max(0.0, 1.0 - step / self.decay_steps)


def places(uniform: NDArray[np.float64], prefilled: int, own: int, mixture: Mixture, step: int) -> NDArray[np.int64]:
    """Slots for the draws `uniform` in [0, 1), shape [..., batch]: 0..prefilled-1, and then those of the agent's own.

    With weight 1 and no share this is floor(u (prefilled + own)): the plain uniform choice.
    """
    weight = mixture.weight(step)
    if not prefilled or not own:
        return (uniform * (prefilled + own)).astype(np.int64)
    if mixture.share is not None:
        first = round(uniform.shape[-1] * mixture.share * weight)
        size, offset = np.full(uniform.shape[-1], own), np.full(uniform.shape[-1], prefilled)
        size[:first], offset[:first] = prefilled, 0
        mixed: NDArray[np.int64] = (uniform * size).astype(np.int64) + offset
        return mixed
    if weight == 1.0:
        return (uniform * (prefilled + own)).astype(np.int64)
    p = weight * prefilled / (weight * prefilled + own)
    from_own: NDArray[np.int64] = prefilled + np.minimum((uniform - p) / (1 - p) * own, own - 1).astype(np.int64)
    if p == 0:
        return from_own
    from_prefill = np.minimum(uniform / p * prefilled, prefilled - 1).astype(np.int64)
    return np.where(uniform < p, from_prefill, from_own)
