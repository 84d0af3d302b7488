"""A matplotlib figure as inline SVG: the same bytes for the same data, nothing outside the page, no id twice."""

import io
import re

from markupsafe import Markup
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from maglev_offline.report.style import figure_style

RASTER_DPI = 180
"""Resolution of the parts that are drawn as pixels."""

_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


def inline_svg(figure: Figure, key: str) -> Markup:
    """Draw a figure for a page; `key` is unique in the page and becomes the prefix of every id.

    Text stays text, in the font of the page. The drawing scales with its container. Ids that nothing refers to go.
    """
    text = io.StringIO()
    with figure_style():
        FigureCanvasSVG(figure).print_figure(text, dpi=RASTER_DPI, format="svg", metadata=_NO_METADATA)
    width, height = (round(72 * side, 2) for side in figure.get_size_inches())
    body = text.getvalue()
    body = body[body.index("<svg") :]
    body = body[body.index(">") + 1 :]
    body = re.sub(r"\s*<defs>\s*<style type=\"text/css\">.*?</style>\s*</defs>", "", body, count=1, flags=re.S)
    body = re.sub(r"<!--.*?-->\s*", "", body, flags=re.S)
    body = re.sub(r"font-family: [^;\"]+;? ?", "", body)
    body = re.sub(r' transform="rotate\(-0 [^"]*\)"', "", body)
    used = set(re.findall(r'(?:url\(|xlink:href=")#([^")]+)', body))
    body = re.sub(r' ?\bid="([^"]+)"', lambda found: f' id="{key}-{found[1]}"' if found[1] in used else "", body)
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{key}-\1)", body)
    body = re.sub(r'xlink:href="#([^"]+)"', rf'href="#{key}-\1"', body)
    body = re.sub(r'xlink:href="data:', 'href="data:', body)
    body = re.sub(r"(base64,)\s+", r"\1", body)
    body = re.sub(r" ?\n", "\n", re.sub(r"\n +", "\n", body))
    # Safe: matplotlib escapes every text that it draws.
    return Markup(f'<svg viewBox="0 0 {width:g} {height:g}" aria-hidden="true" focusable="false">{body}')
