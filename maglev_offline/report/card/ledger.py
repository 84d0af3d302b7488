"""The ledger of a card: at each stage what went in, what was used, and what was left out, by reason."""

from typing import Any

import pandas as pd

from maglev_offline.ingest.samples import QUARANTINE
from maglev_offline.report.card.parts import Parts


def ledger(parts: Parts) -> list[dict[str, Any]]:
    """One entry a stage, JSON-able: `stage`, `unit`, `in`, `used`, `left_out` (by code), `balances`.

    `balances`: what went in is what was used and what was left out.
    """
    total = pd.DataFrame([a.manifest.counts for a in parts.samples]).sum()
    put_aside = _put_aside(parts)
    counts = parts.transitions.manifest.counts
    left_out = {code: n for code, n in parts.transitions.manifest.left_out.items() if n}
    entries = [
        _entry("ingest", "messages", int(total["messages"]), int(total["messages_used"]), put_aside["message"]),
        _entry("ingest", "grid rows", int(total["grid_rows"]), int(total["rows"]), put_aside["sample"]),
        _entry("curate", "rows", counts["rows"], counts["transitions"], left_out),
    ]
    if not_drawn := counts.get("samples_not_drawn", 0):
        drawn = counts["samples"] - not_drawn
        entries.insert(2, _entry("curate", "samples", counts["samples"], drawn, {"samples_not_drawn": not_drawn}))
    for artefact in parts.prefills:
        lost = {code: n for code, n in artefact.manifest.left_out.items() if n}
        used = artefact.manifest.counts["rows"]
        entries.append(_entry(artefact.name, "transitions", counts["transitions"], used, lost))
    return entries


def _entry(stage: str, unit: str, came: int, used: int, left_out: dict[str, int]) -> dict[str, Any]:
    balances = came == used + sum(left_out.values())
    return {"stage": stage, "unit": unit, "in": came, "used": used, "left_out": left_out, "balances": balances}


def _put_aside(parts: Parts) -> dict[str, dict[str, int]]:
    """Counts of the quarantine ledgers of all logs, by level and code."""
    columns = ["level", "code", "count"]
    tables = [pd.read_parquet(a.folder / QUARANTINE, columns=columns) for a in parts.samples]
    joined = pd.concat([table.astype({"level": str, "code": str}) for table in tables])
    sums = joined.groupby(["level", "code"], as_index=False)["count"].sum()
    found: dict[str, dict[str, int]] = {"message": {}, "sample": {}}
    for level, code, n in zip(sums["level"], sums["code"], sums["count"], strict=True):
        found[str(level)][str(code)] = int(n)
    return found
