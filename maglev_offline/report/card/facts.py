"""The card as one JSON-able table: everything the page says, and the hashes to check it by."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pandas as pd

from maglev_offline.ingest.findings import FINDINGS, Finding, by_severity, load_findings
from maglev_offline.report.card.ledger import ledger
from maglev_offline.report.card.parts import Parts
from maglev_offline.report.card.use import intended_use
from maglev_offline.report.evidence import Artefact, without_none

SCHEMA = 1
"""Version of the keys of `card.json`."""

_JUDGED = ("diagnostic", "recovery", "residual", "doubts", "construction", "balance")
"""Facts of the transitions that have a key of their own; the others say what balance changed."""


def card_facts(parts: Parts, name: str, description: str, split: pd.DataFrame) -> dict[str, Any]:
    """Put the card together; `split`: as `splits_of` gives it."""
    facts, manifest = parts.facts, parts.transitions.manifest
    simulated = sum(bool(a.facts.get("simulated")) for a in parts.samples)
    return {
        "schema": SCHEMA,
        "name": name,
        "description": description,
        "intended_use": intended_use(facts, manifest.settings, simulated, len(parts.samples)),
        "sources": [_source(a, split) for a in parts.samples],
        "shared_content": None if parts.shared is None else _by_code(parts.shared),
        "ledger": ledger(parts),
        "construction": facts["construction"],
        "balance": facts["balance"],
        "coverage": {key: value for key, value in facts.items() if key not in _JUDGED},
        "diagnostic": facts["diagnostic"],
        "recovery": facts["recovery"],
        "residual": facts["residual"],
        "doubts": facts["doubts"],
        "splits": {
            str(which): {"logs": list(part["log_id"])}
            | {key: int(part[key].sum()) for key in ("candidates", "transitions")}
            for which, part in split.groupby("split")
        },
        "recipe": _tables(parts),
        "artefacts": {
            a.name: {"hash": a.hash, "fingerprint": a.manifest.fingerprint, "files": a.manifest.files}
            for a in (*parts.samples, parts.transitions, *parts.prefills)
        },
        "versions": _versions(parts),
    }


def splits_of(candidates: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """One row a log: `log_id`, `split`, and how many `candidates` and `transitions` (of the artefact) it gave."""
    curated = pd.read_parquet(folder / "transitions.parquet", columns=["log_id"])
    table = candidates.groupby("log_id", as_index=False).agg(split=("split", "first"), candidates=("split", "size"))
    taken = curated.groupby("log_id").size()
    return table.assign(transitions=table["log_id"].map(taken).fillna(0).astype("int64"))


def _source(log: Artefact, split: pd.DataFrame) -> dict[str, Any]:
    facts = log.facts
    rows = split[split["log_id"] == facts["log_id"]]
    row: dict[str, Any] = (
        {"split": None, "candidates": 0, "transitions": 0} if rows.empty else rows.to_dict("records")[0]
    )
    first, last = facts.get("first_t_ns"), facts.get("last_t_ns")
    return {
        "file": facts.get("file", log.folder.name),
        "log_id": facts["log_id"],
        "sha256": facts.get("sha256"),
        "simulated": bool(facts.get("simulated")),
        "first_t_ns": first,
        "last_t_ns": last,
        "first": _instant(first),
        "last": _instant(last),
        "points": facts.get("points", []),
        "points_left_out": facts.get("points_left_out", {}),
        "counts": log.manifest.counts,
        "signals": without_none(facts.get("signals") or {}),
        "signals_detected": bool(facts.get("signals_detected")),
        "velocity": facts.get("velocity"),
        "set_point": facts.get("set_point"),
        "select": without_none(log.manifest.settings.get("select", {})),
        "findings": _by_code(load_findings(log.folder / FINDINGS)),
        "split": row["split"],
        "candidates": int(row["candidates"]),
        "transitions": int(row["transitions"]),
    }


def _by_code(findings: list[Finding] | tuple[Finding, ...]) -> list[dict[str, Any]]:
    """Findings of one code as one: the first of them in words, and how many `findings` and `places` there are."""
    groups: dict[tuple[str, str], list[Finding]] = {}
    for one in by_severity(findings):
        groups.setdefault((one.severity, one.code), []).append(one)
    return [
        {
            "code": code,
            "severity": severity,
            "about": alike[0].about,
            "findings": len(alike),
            "places": sum(one.count for one in alike),
            "point": alike[0].point,
            "what": alike[0].what,
            "todo": alike[0].todo,
        }
        for (severity, code), alike in groups.items()
    ]


def _tables(parts: Parts) -> dict[str, Any]:
    """The recipe tables that the artefacts were made with; those of `ingest` in which logs differ are named."""
    tables: dict[str, Any] = dict(parts.transitions.manifest.settings)
    first = parts.samples[0].manifest.settings
    differ = [
        name
        for name in first
        if name != "select" and any(a.manifest.settings.get(name) != first[name] for a in parts.samples)
    ]
    tables |= {name: table for name, table in first.items() if name not in (*tables, *differ, "select", "signals")}
    return {"tables": without_none(tables), "differ_between_logs": differ}


def _versions(parts: Parts) -> dict[str, list[str]]:
    """All versions of each package that the artefacts were made with."""
    found: dict[str, set[str]] = {}
    for artefact in (*parts.samples, parts.transitions, *parts.prefills):
        for package, version in artefact.manifest.versions.items():
            found.setdefault(package, set()).add(version)
    return {package: sorted(versions) for package, versions in sorted(found.items())}


def _instant(t_ns: int | None) -> str | None:
    """UTC in ISO 8601 to the millisecond; a log may hold any number for a time."""
    if t_ns is None:
        return None
    try:
        whole: Any = datetime.fromtimestamp(0, UTC) + timedelta(seconds=t_ns // 10**9)
    except OverflowError:
        return None
    return f"{whole:%Y-%m-%dT%H:%M:%S}.{t_ns % 10**9 // 10**6:03d}Z"


def rules_of(settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The rules of a resolved `[curate]` table as the page takes them: `kind`, and what each asks for."""
    return [
        {"kind": kind, **without_none(rule)} for kind in ("include", "exclude") for rule in settings["curate"][kind]
    ]
