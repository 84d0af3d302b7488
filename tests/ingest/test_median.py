"""The median is numpy's, to the last bit."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from maglev_offline.ingest.median import median


@given(st.lists(st.floats(-1e300, 1e300), min_size=1, max_size=50))
def test_of_floats(values):
    assert median(np.array(values)) == np.median(values)


@given(st.lists(st.integers(-(2**52), 2**52), min_size=1, max_size=50))
def test_of_integers(values):
    assert median(np.array(values)) == np.median(np.array(values))
