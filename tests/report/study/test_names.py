"""Names beside points: none over another, each nearest to its own point, none where there is no room."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from maglev_offline.report.study.names import Spot, name_spots


def named(spots):
    figure = Figure(figsize=(4, 3), layout="constrained")
    ax = figure.subplots()
    ax.set(xlim=(0, 1), ylim=(0, 1))
    name_spots(figure, [ax], [spots])
    renderer = FigureCanvasAgg(figure).get_renderer()
    return {text.get_text(): text.get_window_extent(renderer) for text in ax.texts}, ax.transData


def test_points_with_room_are_all_named():
    found, _ = named([Spot(0.2, 0.2, "one"), Spot(0.2, 0.8, "two"), Spot(0.99, 0.5, "at the edge"), Spot(0.5, 0.5, "")])
    assert set(found) == {"one", "two", "at the edge"}


def test_in_a_crowd_a_name_is_nearest_to_its_own_point_or_not_there():
    spots = [Spot(0.5 + 0.01 * (k % 3), 0.4 + 0.02 * k, f"arm{k}") for k in range(9)]
    found, transform = named(spots)
    assert 2 <= len(found) < 9
    boxes = list(found.values())
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    for name, box in found.items():
        away = [
            np.hypot(*(np.clip(at, box.min, box.max) - at))
            for at in (transform.transform((spot.x, spot.y)) for spot in spots)
        ]
        assert np.argmin(away) == int(name[-1])
