"""Tables of a document that are computed: the document keeps a pair of markers, and the table stands between them."""

from collections.abc import Sequence

from maglev_offline.errors import InputError


def table_of(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown, without a line feed at its end."""
    lines = [[cell.replace("|", "\\|") for cell in row] for row in (header, *rows)]
    return "\n".join(f"| {' | '.join(row)} |" for row in [lines[0], ["---"] * len(header), *lines[1:]])


def with_block(text: str, name: str, block: str, where: str = "") -> str:
    """Put `block` between the two markers of `name` in `text`.

    Raises
    ------
    InputError: the markers are not there, once each and in order.
    """
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise InputError(
            f"the table needs the lines {begin} and {end}, once each and in this order.",
            where=where,
            todo="Add them where the table shall stand.",
        )
    return f"{text[: text.index(begin) + len(begin)]}\n\n{block}\n\n{text[text.index(end) :]}"
