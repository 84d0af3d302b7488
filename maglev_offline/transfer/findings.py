"""The tables of a finished study for a document: what each arm did, and which parts of the rows matter.

`python -m maglev_offline.transfer.findings docs/findings.md reports` writes them between the markers of each study
whose folder below `reports` holds a manifest of `transfer`.
"""

import json
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from maglev_offline.errors import InputError
from maglev_offline.markdown import table_of, with_block

Facts = Mapping[str, Any]


def arms_table(facts: Facts, lasting: str = "asymptote") -> str:
    """One line for each arm: its rows, and the differences to an empty buffer in the primary metric and `lasting`."""
    algorithms = list(facts["algorithms"])
    header = ["rows", "before training: verdict, error, correlation"]
    header += [
        f"{metric.replace('_', ' ')}, {name.upper()}" for metric in _metrics(facts, lasting) for name in algorithms
    ]
    header += [f"settle, {name.upper()}" for name in algorithms]
    rows = [
        [
            f"`{arm}`",
            _before(facts, arm),
            *(
                _effect(facts["algorithms"][name]["effects"][arm][metric])
                for metric in _metrics(facts, lasting)
                for name in algorithms
            ),
            *(_settled(facts["algorithms"][name]["arms"][arm]) for name in algorithms),
        ]
        for arm in facts["arms"]
        if arm != "empty"
    ]
    empty = ["`empty`: mean", "", *_means(facts, lasting)]
    empty += [_settled(facts["algorithms"][name]["arms"]["empty"]) for name in algorithms]
    return table_of(header, [empty, *rows])


def _metrics(facts: Facts, lasting: str) -> list[str]:
    return list(dict.fromkeys([facts["primary_metric"], lasting]))


def _means(facts: Facts, lasting: str) -> list[str]:
    arm = next(arm for arm in facts["arms"] if arm != "empty")
    return [
        f"{found['effects'][arm][metric]['baseline_mean']:.2f}"
        for metric in _metrics(facts, lasting)
        for found in facts["algorithms"].values()
    ]


def _before(facts: Facts, arm: str) -> str:
    told = facts["rows"].get(arm, {}).get("diagnostic")
    if told is None:
        return "-"
    correlation = told["correlation_with_advantage"]
    known = "-" if correlation is None else f"{correlation:+.2f}"
    error = told["error_over_advantage_std"]
    return f"{told['verdict']}: {'-' if error is None else f'{error:.2f}'}, {known}"


def _effect(effect: Mapping[str, Any], said: str = "verdict") -> str:
    """`-13.3 (-15.3 to -11.7) negative`; bold where it holds after Holm's correction."""
    span = "" if effect["low"] is None else f" ({effect['low']:+.2f} to {effect['high']:+.2f})"
    text = f"{effect['difference']:+.2f}{span} {effect[said]}"
    return f"**{text}**" if effect["holds_after_holm"] else text


def _settled(arm: Mapping[str, Any]) -> str:
    return f"{round(arm['share_settled'] * arm['seeds'])} of {arm['seeds']}"


def parts_table(facts: Facts) -> str:
    """One line for each part of the rows whose effect holds after Holm's correction in some algorithm."""
    parts: dict[str, dict[str, Any]] = {}
    for found in facts["attribution"]["parts"]:
        parts.setdefault(found["part"], {})[found["algorithm"]] = found
    algorithms = list(facts["algorithms"])
    rows = [
        [
            part,
            f"{next(iter(of.values()))['share_of_rows']:.0%}",
            *(_effect(of[name], "meaning") if name in of else "-" for name in algorithms),
        ]
        for part, of in parts.items()
        if any(found["holds_after_holm"] for found in of.values())
    ]
    return table_of(["part", "share of the rows", *(name.upper() for name in algorithms)], rows)


def blocks_of(reports: Path) -> dict[str, str]:
    """All tables, by the name of their markers: `study`, `study periods/5ms`, `study parts`."""
    found = {}
    for manifest in sorted(reports.rglob("manifest.json")):
        told = json.loads(manifest.read_text(encoding="utf-8"))
        if told.get("artefact") != "transfer" or "-work" in str(manifest.relative_to(reports)):
            continue
        name = manifest.parent.relative_to(reports).as_posix().replace("/", " ", 1)
        found[name] = arms_table(told["facts"])
        if told["facts"].get("attribution", {}).get("parts"):
            found[f"{name} parts"] = parts_table(told["facts"])
    return found


def with_tables(text: str, reports: Path, where: str = "") -> str:
    """The document with every table for which it has markers, such as `<!-- study of cure: begin -->`.

    Raises
    ------
    InputError: markers that are not a pair, or of a study that is not there.
    """
    blocks = blocks_of(reports)
    for name in re.findall(r"<!-- study of (.+?): begin -->", text):
        if name not in blocks:
            raise InputError(f"there is no study {name!r} to fill the table with.", where=where, todo=str(reports))
        text = with_block(text, f"study of {name}", blocks[name], where)
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the tables into the document named; 2 if it cannot take them."""
    given = [Path(one) for one in (sys.argv[1:] if arguments is None else arguments)]
    try:
        if len(given) != 2 or not given[0].is_file() or not given[1].is_dir():
            raise InputError(
                "a document and the folder of reports are needed.",
                todo="Usage: python -m maglev_offline.transfer.findings FILE.md reports",
            )
        document, reports = given
        text = document.read_text(encoding="utf-8")
        document.write_text(with_tables(text, reports, str(document)), encoding="utf-8")
    except InputError as error:
        print(error.paragraph(), file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
