"""How the templates of pages are set: every text escaped, nothing in it that no page may hold."""

import base64
import hashlib
import json
from collections.abc import Mapping
from typing import Any

import jinja2
from markupsafe import Markup

from maglev_offline.report.numbers import NO_BREAK


def page_environment() -> jinja2.Environment:
    """The templates of `report/templates`; a name that is not given is an error, and not a blank."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("maglev_offline.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_set,
    )


def source(name: str) -> str:
    """A template's text as it stands: a script or a style sheet."""
    environment = page_environment()
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]


def script_mark(script: str) -> str:
    """The hash by which a page's security policy names its one script, so that nothing else on it can run.

    An inline script runs to the end of its tag, so that the hash is that of all in between.
    """
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")


def json_block(value: Mapping[str, Any]) -> Markup:
    """JSON for a block of data in the page: no name of a log can end the block."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


_CONTROLS = dict.fromkeys((*range(9), 11, 12, *range(14, 32), *range(127, 160)), "�")


def printable(text: str) -> str:
    """Replace control characters, which no page and no font has."""
    return text.translate(_CONTROLS)


def _set(value: object) -> object:
    """Printable, and per cent signs stay with their numbers."""
    return printable(value).replace(" %", f"{NO_BREAK}%") if type(value) is str else value
