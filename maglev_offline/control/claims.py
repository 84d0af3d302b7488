"""The paper's sections II, VI-A and VI-B held against this code: claim, paper, measured, verdict.

Every measured value is computed when `claims` is called, and the table says what it is here.
`python -m maglev_offline.control.claims docs/findings.md` writes the table into the document.
"""

import sys
from collections.abc import Sequence
from dataclasses import astuple, fields
from pathlib import Path

import pyarrow as pa

from maglev_offline.control.claim import Claim
from maglev_offline.control.claims_measured import GROUPS
from maglev_offline.errors import InputError
from maglev_offline.markdown import table_of, with_block
from maglev_offline.progress import SILENT, Progress


def claims(progress: Progress = SILENT) -> list[Claim]:
    """Compute the whole table: some hundred thousand plant steps, about ten seconds."""
    found: list[Claim] = []
    with progress.task("claims", len(GROUPS), "groups") as tick:
        for group in GROUPS:
            found += group()
            tick(1)
    return found


def claims_to_table(found: Sequence[Claim]) -> pa.Table:
    """The table for reports: string columns section, statement, paper, measured, verdict, setting."""
    names = [field.name for field in fields(Claim) if field.name != "tolerance"]
    return pa.table({name: pa.array([getattr(claim, name) for claim in found], pa.string()) for name in names})


def claims_table(found: Sequence[Claim]) -> list[list[str]]:
    """The same as plain text, all columns, the header first."""
    return [[field.name for field in fields(Claim)], *(list(astuple(claim)) for claim in found)]


def as_markdown(found: Sequence[Claim]) -> str:
    """The table in Markdown, one line for each claim, without a line feed at its end."""
    header, *rows = claims_table(found)
    return table_of(header, rows)


def with_table(text: str, table: str, where: str = "") -> str:
    """Put the Markdown `table` between the two markers in `text`."""
    return with_block(text, "claims", table, where)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the table into the document named; 2 if it cannot take it."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if len(given) != 1:
            raise InputError("one document is needed.", todo="Usage: python -m maglev_offline.control.claims FILE.md")
        path = Path(given[0])
        if not path.is_file():
            raise InputError("no such file.", where=str(path))
        text = path.read_text(encoding="utf-8")
        with_table(text, "", str(path))  # before the work, not after it
        path.write_text(with_table(text, as_markdown(claims()), str(path)), encoding="utf-8")
    except InputError as error:
        print(error.paragraph(), file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
