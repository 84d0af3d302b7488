"""Axes about zero hold the data, the margin and few ticks, whatever the sizes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from maglev_offline.report.study.axes import about_zero

sizes = st.floats(1e-6, 1e8)


@settings(max_examples=25, deadline=None)
@given(low=sizes, high=sizes, margin=sizes)
def test_axis_holds_all_of_it(low, high, margin):
    ax = Figure().subplots()
    said = about_zero(ax, "x", [-low, high, np.nan], margin)
    left, right = ax.get_xlim()
    assert left < min(-low, -margin)
    assert right > max(high, margin)
    compressed = max(low, high) > 12 * margin
    assert (ax.get_xscale() == "symlog") == compressed == ("logarithmic" in said)
    if compressed:
        assert len(ax.get_xticks()) <= 7


@pytest.mark.parametrize("values", [[], [np.nan], [0.0]])
def test_nothing_to_show_still_has_an_axis(values):
    ax = Figure().subplots()
    assert about_zero(ax, "y", values, 1.0) == ""
    assert ax.get_ylim()[0] < -1 < 1 < ax.get_ylim()[1]


def test_ticks_have_signs():
    ax = Figure().subplots()
    about_zero(ax, "x", [-200.0, 40.0], 0.5)
    write = ax.xaxis.get_major_formatter()
    assert [write(tick, None) for tick in ax.get_xticks()] == ["−100", "−10", "−1", "0", "+1", "+10"]
