"""The card as one HTML page: a script of its own and no other, no network."""

import base64
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from maglev_offline import __version__
from maglev_offline.report.card.sections import head_of, sections_of
from maglev_offline.report.typesetting import page_environment


def card_page(card: Mapping[str, Any], scatter: Mapping[str, Any]) -> str:
    """Set the page; `scatter`: as `sample.packed` gives it.

    The page's security policy names the hash of its one script, so nothing that a log holds could run.
    """
    environment = page_environment()
    environment.tests["block"] = lambda block, kind: type(block).__name__ == kind
    script, style = (_source(name) for name in ("card.js", "card.css"))
    # An inline script runs to the end of its tag, so that the hash is that of all in between.
    mark = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    return environment.get_template("card.html.j2").render(
        card=card,
        head=head_of(card),
        sections=sections_of(card),
        scatter=_data(scatter),
        axes=[column for column in scatter["columns"] if column["axis"]],
        rows=scatter["rows"],
        candidates=scatter["candidates"],
        script=Markup(script),
        script_mark=mark,
        style=Markup(style),
        version=__version__,
    )


def _source(name: str) -> str:
    environment = page_environment()
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]


def _data(value: Mapping[str, Any]) -> Markup:
    """JSON for a block of data in the page: no name of a log can end the block."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))
