"""Named streams of random numbers: every draw belongs to one purpose of one seed."""

from zlib import crc32

import numpy as np


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the stream `name` of `seed`.

    Two streams of one seed, or one stream of two seeds, are independent; the same pair always gives the same
    numbers, whatever else is drawn before or beside it.
    """
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(crc32(name.encode()),))))
