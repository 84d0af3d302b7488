"""The card as one HTML page: a script of its own and no other, no network."""

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from maglev_offline import __version__
from maglev_offline.report.card.sections import head_of, sections_of
from maglev_offline.report.typesetting import json_block, page_environment, script_mark, source


def card_page(card: Mapping[str, Any], scatter: Mapping[str, Any]) -> str:
    """Set the page; `scatter`: as `sample.packed` gives it.

    The page's security policy names the hash of its one script, so nothing that a log holds could run.
    """
    environment = page_environment()
    environment.tests["block"] = lambda block, kind: type(block).__name__ == kind
    script, style = (source(name) for name in ("card.js", "card.css"))
    return environment.get_template("card.html.j2").render(
        card=card,
        head=head_of(card),
        sections=sections_of(card),
        scatter=json_block(scatter),
        axes=[column for column in scatter["columns"] if column["axis"]],
        rows=scatter["rows"],
        candidates=scatter["candidates"],
        script=Markup(script),
        script_mark=script_mark(script),
        style=Markup(style),
        version=__version__,
    )
