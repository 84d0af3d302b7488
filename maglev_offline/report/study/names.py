"""Names beside the points of a scatter, each where there is room for it, none over another."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from maglev_offline.report.style import INK

_PLACES: tuple[tuple[float, float, Literal["left", "right", "center"]], ...] = (
    *((6, 0, "left"), (-6, 0, "right"), (0, 9, "center"), (0, -9, "center")),
    *((6, 7, "left"), (6, -7, "left"), (-6, 7, "right"), (-6, -7, "right")),
    *((-4, 9, "left"), (-4, -9, "left"), (4, 9, "right"), (4, -9, "right")),
)
"""Where a name may lie about its point, in typographic points, and how it is set there; the first that fits."""

Place = NDArray[np.float64]
"""Where a point lies, in pixels of the draft [2]."""

_RADIUS, _SMALL = 4.5, 2.0
"""Half the size of a point with a name, and of one without, in pixels of the draft."""


class Spot(NamedTuple):
    """A point in the data's units, and its name; without one it only takes its room."""

    x: float
    y: float
    name: str


def name_spots(figure: Figure, axes: Sequence[Axes], spots: Sequence[Sequence[Spot]]) -> None:
    """Write the names of the spots of each panel; one that has no room, whichever side it is on, is left out."""
    renderer: RendererBase = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    figure.draw_without_rendering()  # settles the layout, which says how much room there is
    for ax, part in zip(axes, spots, strict=True):
        centres = [ax.transData.transform((spot.x, spot.y)) for spot in part]
        taken = [_around(x, y, _RADIUS if spot.name else _SMALL) for (x, y), spot in zip(centres, part, strict=True)]
        named = [(spot, at) for spot, at in zip(part, centres, strict=True) if spot.name]
        for spot, at in named:
            others = [other for _, other in named if other is not at]
            _name(ax, spot, taken, partial(_is_nearest, at=at, others=others), renderer)


def _around(x: float, y: float, radius: float) -> Bbox:
    return Bbox.from_extents(x - radius, y - radius, x + radius, y + radius)


def _distance(box: Bbox, at: Place) -> float:
    return float(np.hypot(*(max(low - p, 0.0, p - high) for p, low, high in zip(at, box.min, box.max, strict=True))))


def _is_nearest(box: Bbox, at: Place, others: Sequence[Place]) -> bool:
    """Whether a name is nearer to its own point than to any other that has one, so that it is not taken for theirs."""
    return all(_distance(box, at) < _distance(box, other) for other in others)


def _name(ax: Axes, spot: Spot, taken: list[Bbox], is_clear: Callable[[Bbox], bool], renderer: RendererBase) -> None:
    """Write one name where it overlaps nothing of `taken` and is clearly its point's, and add it there."""
    text = ax.annotate(
        spot.name, (spot.x, spot.y), xytext=(0, 0), textcoords="offset points", fontsize=7.5, color=INK, va="center"
    )
    for dx, dy, side in _PLACES:
        text.set_position((dx, dy))
        text.set_horizontalalignment(side)
        box = text.get_window_extent(renderer).padded(1.5)
        inside = ax.bbox.x0 <= box.x0 and box.x1 <= ax.bbox.x1 + 8 and ax.bbox.y0 <= box.y0 and box.y1 <= ax.bbox.y1
        if inside and is_clear(box) and not any(box.overlaps(other) for other in taken):
            taken.append(box)
            return
    text.remove()
