"""One colour for each controller and arm, wherever it is drawn, and the look of all figures.

The colours are Okabe and Ito's, which stay apart under every common colour vision deficiency; line styles differ too.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from maglev_offline.report.numbers import power_of_ten

INK, SOFT, RULE = "#1f2328", "#59636e", "#d4d8dd"
QUARANTINE = "#b3261e"

FULL_WIDTH = 9.0
"""Width in inches of a figure that takes the whole page."""


class Stroke(NamedTuple):
    """How one controller or arm is drawn, and what it is called in legends."""

    label: str
    colour: str
    dash: Any = "-"


CONTROLLERS = {
    "pid": Stroke("PID", "#4d4d4d"),
    "cascade": Stroke("cascade", "#999999", (0, (5, 1.5))),
    "lqr": Stroke("LQR", "#009E73"),
    "lqr_held": Stroke("LQR, held", "#56B4E9", (0, (3, 1, 1, 1))),
    "lqi": Stroke("LQI", "#CC79A7", (0, (4, 1.5))),
    "lqi_ekf": Stroke("LQI + EKF", "#7B3294", (0, (1, 1.2))),
}
ARMS = {
    "empty": Stroke("empty buffer", "#0072B2"),
    "prefill": Stroke("prefilled buffer", "#D55E00", (0, (6, 1.2))),
}
SIGNALS = {"logged": "#0072B2", "set_point": "#4d4d4d"}
VERDICTS = {"positive": "#0072B2", "negative": "#D55E00", "equivalent": "#4d4d4d", "inconclusive": "#8c959f"}

_SPARE = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#882255")
_DASHES = ((0, (2, 1)), (0, (5, 1.5)), (0, (1, 1.2)), (0, (4, 1, 1, 1)))
"""Arms without a colour of their own take the colours in turn, then the same colours with the next dash: 20 of them."""

_RC: dict[str, Any] = {
    "axes.edgecolor": "#8c959f",
    "axes.formatter.use_mathtext": False,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 9,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "figure.facecolor": "none",
    "figure.dpi": 100,
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
    "savefig.facecolor": "none",
    "svg.fonttype": "none",
    "svg.hashsalt": "maglev-offline",
    "text.color": INK,
    "text.parse_math": False,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Give every figure that is made or drawn inside the same look, whatever the user's own settings are."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_RC)  # type: ignore[arg-type]
        yield


def controller_stroke(name: str) -> Stroke:
    """How a classical controller is drawn."""
    return CONTROLLERS.get(name, Stroke(name, _SPARE[0]))


def arm_stroke(name: str, arms: Iterable[str] = ()) -> Stroke:
    """How an arm is drawn; arms without a colour of their own take spare ones in the order of `arms`."""
    if name in ARMS:
        return ARMS[name]
    others = [arm for arm in arms if arm not in ARMS]
    place = others.index(name) if name in others else 0
    dash = _DASHES[place // len(_SPARE) % len(_DASHES)]
    return Stroke(name, _SPARE[place % len(_SPARE)], dash)


def algorithm_label(name: str) -> str:
    """DDPG, TD3: algorithms are written in capitals."""
    return name.upper()


def log_ticks(ax: Axes, axis: str) -> None:
    """Label the powers of ten, and 2 and 5 where there are less than two of them, without TeX."""
    low, high = sorted(ax.get_xlim() if axis == "x" else ax.get_ylim())
    part = ax.xaxis if axis == "x" else ax.yaxis
    places = [t for t in LogLocator(subs=(1.0,)).tick_values(low, high) if low <= t <= high]
    if len(places) < 3:
        places = [t for t in LogLocator(subs=(1.0, 2.0, 5.0)).tick_values(low, high) if low <= t <= high]
    part.set_major_locator(FixedLocator(places))
    part.set_major_formatter(FuncFormatter(_plain_power))
    part.set_minor_formatter(NullFormatter())


def _plain_power(value: float, _: object = None) -> str:
    if 1e-3 <= value < 1e5:
        return f"{value:,g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return power_of_ten(int(exponent)) if mantissa == "1" else f"{mantissa}·{power_of_ten(int(exponent))}"
