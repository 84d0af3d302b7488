"""What a page is made of: sections of paragraphs, notes, tables, figures and text as it is. No data, no markup."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from matplotlib.figure import Figure


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of prose; a `note` is set apart, a `warning` more so; `lead` and `abstract` head the page."""

    text: str
    kind: Literal["prose", "lead", "abstract", "note", "warning"] = "prose"
    command: str = ""


@dataclass(frozen=True)
class Points:
    """A list of short statements."""

    items: Sequence[str]


@dataclass(frozen=True)
class Table:
    """A table: the first `labels` columns are words, the others numbers, which are set to the right.

    Every cell is text already; the first of a row names the row. `sources`: names of the artefacts that the numbers are
    from, to which the caption links; `anchors`: an id for each row, to be linked to; `folded`: shown when asked for.
    """

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    labels: int = 1
    marks: Sequence[str] = ()
    """A class for each row, such as a verdict; may be left out."""
    sources: Sequence[str] = ()
    anchors: Sequence[str] = ()
    folded: bool = False


@dataclass(frozen=True)
class Plot:
    """A figure with its key (unique in the page), caption, and what it says for those who do not see it.

    `figure` makes it once the page is set: who asks for the words of a section does not wait for it.
    """

    key: str
    figure: Callable[[], Figure]
    caption: str
    label: str
    sources: Sequence[str] = ()


@dataclass(frozen=True)
class Live:
    """A figure that a script of the page draws from `data`; `still` stands for it in print and without a script."""

    key: str
    data: Mapping[str, Any]
    caption: str
    label: str
    still: Plot


@dataclass(frozen=True)
class Verbatim:
    """Text as it is, such as commands or a recipe's table."""

    caption: str
    text: str


Block = Paragraph | Points | Table | Plot | Live | Verbatim


@dataclass
class Section:
    """One part of the page, with its anchor."""

    key: str
    title: str
    blocks: list[Block] = field(default_factory=list)


def not_yet(what: str, command: str, *, wanted: bool = True) -> Paragraph:
    """Stand in for a part whose artefact has not been made: one sentence and the command that makes it.

    `wanted`: false where the recipe trains no agent, so that no command is to be run.
    """
    if not wanted:
        return Paragraph("The recipe trains no agent, so there is nothing to show here.", "note")
    return Paragraph(f"{what} To make this part, run", "note", command)
