"""The section on how to do it again: the resolved recipe, versions, hashes, command lines."""

from collections.abc import Mapping
from typing import Any

from maglev_offline.report.evidence import Evidence
from maglev_offline.report.numbers import whole
from maglev_offline.report.page import Block, Paragraph, Section, Table, Verbatim


def recipe_section(
    evidence: Evidence, recipe: Mapping[str, Any], recipe_name: str, mark: str, *, trains: bool = True
) -> Section:
    """The whole recipe, the versions and hashes of all artefacts, and the commands."""
    section = Section("recipe", "Recipe, versions and hashes")
    steps = ["control", *(["prefill", "transfer"] if trains else []), "report"]
    logs = "" if recipe.get("logs") else " LOGS..."
    commands = "\n".join(
        [
            f"maglev-offline run RECIPE.toml{logs}     # all of it; RECIPE.toml is “{recipe_name}”, see below",
            "",
            "maglev-offline ingest LOGS... --recipe RECIPE.toml   # the same in steps",
            *(f"maglev-offline {step}" for step in steps),
        ]
    )
    section.blocks += [
        Verbatim("The command lines to do it again.", commands),
        *_versions(evidence),
        *_artefacts(evidence),
        Paragraph(f"Fingerprint of this report (inputs, recipe and settings): {mark}"),
        Verbatim(
            f"The recipe “{recipe_name}”, resolved: defaults are filled in; a unit is the end of its key.",
            toml_text(recipe),
        ),
    ]
    return section


def _versions(evidence: Evidence) -> list[Block]:
    found: dict[str, dict[str, list[str]]] = {}
    for name, artefact in evidence.artefacts.items():
        for package, version in artefact.manifest.versions.items():
            found.setdefault(package, {}).setdefault(version, []).append(name)
    if not found:
        return []
    rows = [[package, ", ".join(sorted(versions))] for package, versions in sorted(found.items())]
    blocks: list[Block] = [Table("Versions that the artefacts were made with.", ["package", "version"], rows, labels=2)]
    mixed = [package for package, versions in found.items() if len(versions) > 1]
    if mixed:
        text = f"The artefacts were not all made with the same version of {', '.join(sorted(mixed))}."
        blocks.append(Paragraph(text, "warning"))
    return blocks


def _artefacts(evidence: Evidence) -> list[Block]:
    if not evidence.artefacts:
        return [Paragraph("The workspace holds no artefact yet.", "note")]
    rows = [
        [
            name,
            ", ".join(f"{key.replace('_', ' ')} {whole(n)}" for key, n in list(a.manifest.counts.items())[:3]),
            a.hash[:16],
            a.manifest.fingerprint[:16],
        ]
        for name, a in evidence.artefacts.items()
    ]
    caption = (
        "The artefacts. Hash: the first 16 digits of the SHA-256 of the manifest, which holds the hash of every file; "
        "fingerprint: of all that the artefact depends on."
    )
    head = ["artefact", "counts", "hash", "fingerprint"]
    return [Table(caption, head, rows, labels=4, anchors=list(evidence.anchors.values()))]


def toml_text(recipe: Mapping[str, Any]) -> str:
    """Write the recipe as TOML: plain keys first, then each table under its dotted name."""
    lines: list[str] = []
    _table(recipe, (), lines)
    return "\n".join(lines).strip()


def _table(table: Mapping[str, Any], path: tuple[str, ...], lines: list[str]) -> None:
    plain = {key: value for key, value in table.items() if not isinstance(value, Mapping)}
    if path and (plain or not table):
        lines += ["", f"[{'.'.join(path)}]"]
    lines += [
        f"{key} = {_value(value)}" if value is not None else f"# {key}: not given" for key, value in plain.items()
    ]
    for key, value in table.items():
        if isinstance(value, Mapping):
            _table(value, (*path, key), lines)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(part)}" for key, part in value.items()) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(part) for part in value)}]"
    return repr(value)
