"""How the templates of pages are set: every text escaped, nothing in it that no page may hold."""

import jinja2

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


_CONTROLS = dict.fromkeys((*range(9), 11, 12, *range(14, 32), *range(127, 160)), "�")


def printable(text: str) -> str:
    """Replace control characters, which no page and no font has."""
    return text.translate(_CONTROLS)


def _set(value: object) -> object:
    """Printable, and per cent signs stay with their numbers."""
    return printable(value).replace(" %", f"{NO_BREAK}%") if type(value) is str else value
