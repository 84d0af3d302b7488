"""The step of a quantiser is read off its levels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from maglev_offline.ingest.checks.quantum import quantum


@hypothesis_settings(deadline=None, max_examples=60)
@given(step=st.floats(1e-6, 10), levels=st.integers(20, 200), offset=st.floats(-5, 5), seed=st.integers(0, 99))
def test_the_step_is_found(step, levels, offset, seed):
    numbers = np.random.default_rng(seed).integers(0, levels, 2000)
    assert quantum(np.sort(numbers * step + offset * step)) == pytest.approx(step, rel=1e-6)


def test_levels_that_were_rounded_give_the_step_before_rounding():
    numbers = np.random.default_rng(0).integers(0, 300, 2000)
    assert quantum(np.sort(np.round(numbers * 48.8e-6, 6))) == pytest.approx(48.8e-6, rel=2e-3)


@pytest.mark.parametrize(
    "values",
    [np.sort(np.random.default_rng(0).normal(size=2000)), np.zeros(2000), np.arange(10.0), np.empty(0)],
    ids=["continuous", "constant", "few", "none"],
)
def test_values_without_levels_show_no_step(values):
    assert quantum(values) is None
