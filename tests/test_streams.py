"""Streams: reproducible, and independent of each other."""

import numpy as np

from maglev_offline.streams import stream


def test_same_pair_same_numbers() -> None:
    np.testing.assert_array_equal(stream(3, "noise").random(5), stream(3, "noise").random(5))


def test_pinned() -> None:
    """Stored artefacts depend on these numbers: a change here is a change of every result."""
    np.testing.assert_allclose(
        stream(0, "noise").random(2), [0.8098087361019186, 0.19623835630139752], rtol=0, atol=1e-15
    )


def test_other_seed_or_name_other_numbers() -> None:
    draws = [stream(seed, name).random(2000) for seed in (0, 1) for name in ("a", "b")]
    correlation = np.corrcoef(draws) - np.eye(4)
    assert np.abs(correlation).max() < 0.1
