"""What a residual map comes to: which logs and regions the simulator does not explain, worst first."""

from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.curate.diagnostic_cells import TOO_FEW
from maglev_offline.curate.residual_map import SIGNALS, STEPS_AHEAD
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

MOST_LISTED = 5
"""So many logs and regions are listed; the map has all."""

_ENDS = ("gap_from_m", "gap_to_m", "velocity_from_m_s", "velocity_to_m_s")


def residual_facts(table: pd.DataFrame, plant: Plant) -> dict[str, Any] | None:
    """Sum up the shortest length of a residual map; None where there was nothing to compare.

    `growth`: by which factor an error of the state grows in that time, by the fastest pole at the set-point.
    """
    if not (table["steps"] == STEPS_AHEAD[0]).any():
        return None
    table = pd.concat([table, sizes(table)], axis=1)
    shortest = table[table["steps"] == STEPS_AHEAD[0]]
    whole = shortest[shortest["kind"] == "all"].pipe(_records)[0]
    duration_s = float(whole["duration_s"])
    growth = float(np.exp(linearise(plant).poles[0].real * duration_s))
    every = _records(table[table["kind"] == "all"])
    return {
        "duration_s": duration_s,
        "growth": growth,
        **_numbers(whole),
        "longer": [{"duration_s": float(row["duration_s"]), **_numbers(row)} for row in every[1:]],
        "logs": _count(shortest, "log"),
        "worst_logs": [{"log_id": row["log_id"], **_numbers(row)} for row in _worst(shortest, "log")],
        "regions": _count(shortest, "region"),
        "worst_regions": [
            {**{name: _finite(row[name]) for name in _ENDS}, **_numbers(row)} for row in _worst(shortest, "region")
        ],
    }


def sizes(table: pd.DataFrame) -> pd.DataFrame:
    """Norms over gap, velocity and current, in state scales: `rms` and `change`, and `mean`, the offset in the rms."""
    squares = {
        what: sum(table[f"{name}_{what}"].to_numpy(dtype=np.float64) ** 2 for name in SIGNALS)
        for what in ("mean", "rms", "change")
    }
    return pd.DataFrame({what: np.sqrt(square) for what, square in squares.items()}, index=table.index)


def _count(table: pd.DataFrame, kind: str) -> dict[str, int]:
    verdict = table.loc[table["kind"] == kind, "verdict"]
    return {
        "judged": int((verdict != TOO_FEW).sum()),
        **{name: int((verdict == name).sum()) for name in ("explained", "open", "unexplained")},
        "offset": int(table.loc[table["kind"] == kind, "offset"].sum()),
    }


def _worst(table: pd.DataFrame, kind: str) -> list[dict[str, Any]]:
    """Those parts of a kind that are unexplained, the largest residual first, at most `MOST_LISTED`."""
    parts = table[(table["kind"] == kind) & (table["verdict"] == "unexplained")]
    order = np.argsort(-parts["rms"].to_numpy(), kind="stable")[:MOST_LISTED]
    return _records(parts.iloc[order])


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(name): value for name, value in row.items()} for row in table.to_dict("records")]


def _numbers(row: dict[str, Any]) -> dict[str, Any]:
    """The numbers of one row of the map, plain; None where there is none."""
    return {
        "windows": int(row["rows"]),
        **{f"{what}_state_scales": _finite(row[what]) for what in ("rms", "mean", "change")},
        "unexplained_share": _finite(row["unexplained_share"]),
        "unexplained_share_interval": _span(row, "unexplained_share"),
        "offset_share": _finite(row["offset_share"]),
        "offset_share_interval": _span(row, "offset_share"),
        "verdict": str(row["verdict"]),
        "offset": bool(row["offset"]),
    }


def _span(row: dict[str, Any], name: str) -> list[float] | None:
    span = [float(row[f"{name}_low"]), float(row[f"{name}_high"])]
    return span if np.isfinite(span).all() else None


def _finite(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
