"""Axes about zero that stay readable where a few effects dwarf the margin, and what all of them show."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from maglev_offline.report.style import INK, VERDICTS

MARGIN = "#e6e8eb"
"""Colour of the band within which a difference does not matter."""

WIDE = "\N{EM SPACE}" * 2
"""A space that a page does not close up."""

_DWARFED = 12
"""So many margins away, effects on a linear axis would leave nothing of the margin to see."""


def about_zero(ax: Axes, axis: str, values: Sequence[float], margin: float, most: int = 3) -> str:
    """Set the limits of an axis (`x` or `y`) about zero to hold `values`; compress it where they dwarf the margin.

    Returns what to add to the label: nothing, or from where on the axis is logarithmic. At most `most` ticks a side.
    """
    finite = [value for value in values if np.isfinite(value)]
    low, high = min(finite, default=0.0), max(finite, default=0.0)
    reach = max(-low, high)
    part = ax.xaxis if axis == "x" else ax.yaxis
    limits = ax.set_xlim if axis == "x" else ax.set_ylim
    compressed = margin > 0 and reach > _DWARFED * margin
    if compressed:
        (ax.set_xscale if axis == "x" else ax.set_yscale)("symlog", linthresh=2 * margin, linscale=0.8)
    part.set_major_formatter(FuncFormatter(lambda value, _: f"{value:+,g}".replace("-", "−") if value else "0"))
    part.set_minor_locator(NullLocator())
    if not compressed:
        pad = 0.06 * max(high - low, 4 * margin, 1e-9)
        limits(min(low, -2 * margin) - pad, max(high, 2 * margin) + pad)
        part.set_major_locator(MaxNLocator(2 * most))
        return ""
    threshold = 2 * margin
    limits(_beyond(low, -threshold), _beyond(high, threshold))
    below, above = (_places(threshold, end, most) for end in (-low, high))
    part.set_major_locator(FixedLocator([*(-place for place in reversed(below)), 0.0, *above]))
    return f" (logarithmic beyond ±{float(f'{threshold:.2g}'):,g})"


def _beyond(end: float, threshold: float) -> float:
    """A little farther than the data, and than the linear part."""
    return 1.35 * (end if abs(end) > abs(threshold) and end * threshold > 0 else threshold)


def _places(threshold: float, reach: float, most: int) -> list[float]:
    """Ticks of one side: 1 and 3 of each decade where there is room for both, else powers of ten, evenly."""
    decades = range(int(np.floor(np.log10(threshold))), int(np.ceil(np.log10(max(reach, threshold)))) + 1)
    for steps in ((1, 3), (1,)):
        places = [float(f"{step}e{decade}") for decade in decades for step in steps]
        places = [place for place in places if threshold <= place <= 1.3 * reach]
        if len(places) <= most:
            return places
    stride = -(-len(places) // most)
    return places[::-1][::stride][::-1]


def margin_band(ax: Axes, margin: float, axis: str = "x") -> None:
    """Shade what does not matter, and draw zero."""
    (ax.axvspan if axis == "x" else ax.axhspan)(-margin, margin, color=MARGIN, linewidth=0, zorder=0)
    (ax.axvline if axis == "x" else ax.axhline)(0, color=INK, linewidth=0.8, zorder=1)


def draw_effect(
    ax: Axes,
    y: float,
    low: float | None,
    high: float | None,
    middle: float,
    verdict: str,
    colour: str,
    marker: str = "o",
) -> None:
    """One mean with its interval, where it has one: filled where the interval decides, else hollow."""
    if low is not None and high is not None:
        ax.hlines(y, low, high, color=colour, linewidth=2.2, zorder=3)
    face = colour if verdict in ("positive", "negative") else "white"
    ax.plot(middle, y, marker, markersize=5.5, color=colour, markerfacecolor=face, zorder=4)


def verdict_handles(verdicts: Sequence[str]) -> list[Line2D]:
    """A legend of the verdicts that occur, in the order good to bad."""
    order = [word for word in VERDICTS if word in verdicts]
    return [
        Line2D(
            [],
            [],
            color=VERDICTS[word],
            marker="o",
            markersize=5.5,
            linewidth=2.2,
            markerfacecolor=VERDICTS[word] if word in ("positive", "negative") else "white",
            label=word,
        )
        for word in order
    ]
