"""The rows in the page: a seeded sample of the candidates, packed so that the page sees the very numbers of the table.

Numbers are float64, since a rule is held against them, and both ends of its ranges are included: a gap of 0.1 mm, as
sensors write it, must lie in a range up to 0.1 mm in the page as it does in `curate`.
"""

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.curate.constructions.rows import NEXT_STATE, STATE
from maglev_offline.curate.diagnostic import FIT_ERROR, HARMFUL_ERROR, targets_of
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.streams import stream

MOST_ROWS = 5000

KEY = ["log_id", "point", "segment", "step", "substep"]
"""What names a row in all tables of the artefact."""

AXES = {
    "gap_error_m": "gap error, m",
    "gap_velocity_m_s": "gap velocity, m/s",
    "current_error_a": "current error, A",
    "voltage_deviation_v": "voltage deviation, V",
}
NUMBERS = (*AXES, "cost", "duration_s")
"""The columns that rules have ranges of."""

CURATED, HELD_OUT, NOT_SELECTED = 1, 2, 0
NOT_JUDGED, TRUE, BETWEEN, FALSE = 0, 1, 2, 3


def read_candidates(folder: Path) -> pd.DataFrame:
    """What the card needs of `candidates.parquet`."""
    columns = dict.fromkeys([*KEY, *NUMBERS, *STATE, *NEXT_STATE, "discount", "split"])
    return pd.read_parquet(folder / "candidates.parquet", columns=list(columns))


def sample_of(
    candidates: pd.DataFrame, folder: Path, plant: Plant, mdp: Mdp, seed: int, most: int = MOST_ROWS
) -> pd.DataFrame:
    """Draw at most `most` candidates, in their order, with the columns `state` and `judged` (codes, see above).

    The draw is uniform, as many of each split as its share: a share of the sample estimates that of the candidates.
    The targets of all its rows are judged, by the spread of the advantage that the diagnostic found.
    """
    chosen = candidates.iloc[_chosen(candidates, seed, most)].reset_index(drop=True)
    taken = pd.read_parquet(folder / "transitions.parquet", columns=KEY).assign(taken=True)
    curated = chosen.merge(taken, on=KEY, how="left")["taken"].notna().to_numpy()
    state = np.where(curated, CURATED, np.where(chosen["split"] == "train", NOT_SELECTED, HELD_OUT))
    spread = _spread(pd.read_parquet(folder / "diagnostic_rows.parquet", columns=["advantage", "weight"]))
    if spread == 0:
        return chosen.assign(state=state, judged=NOT_JUDGED)
    ratio = np.abs(targets_of(chosen, plant, mdp).error) / spread
    degree = np.where(ratio <= FIT_ERROR, TRUE, np.where(ratio < HARMFUL_ERROR, BETWEEN, FALSE))
    return chosen.assign(state=state, judged=degree)


def _spread(judged: pd.DataFrame) -> float:
    """Standard deviation of the advantage, of rows that stand for `weight` rows each."""
    mean = np.average(judged["advantage"], weights=judged["weight"])
    return float(np.sqrt(np.average((judged["advantage"] - mean) ** 2, weights=judged["weight"])))


def _chosen(rows: pd.DataFrame, seed: int, most: int) -> np.ndarray:
    """Places of the sample in `rows`, in rising order."""
    if len(rows) <= most:
        return np.arange(len(rows))
    order = stream(seed, "card: sample").permutation(len(rows))
    training = (rows["split"] == "train").to_numpy()[order]
    of_training = round(most * training.mean())
    return np.sort(np.concatenate([order[training][:of_training], order[~training][: most - of_training]]))


def packed(sample: pd.DataFrame, candidates: pd.DataFrame, rules: list[dict[str, Any]]) -> dict[str, Any]:
    """JSON-able, for the script of the page: numbers and codes column by column, base64, little-endian.

    `numbers`: float64, `columns` in order; `codes`: uint16, log, point, state and judged. `from` and `to` of a column:
    its extremes over all candidates. `rules`: those that the candidates were made with.
    """
    logs, points = (sorted(candidates[name].unique()) for name in ("log_id", "point"))
    codes = [pd.Index(logs).get_indexer(sample["log_id"]), pd.Index(points).get_indexer(sample["point"])]
    codes += [sample[name].to_numpy() for name in ("state", "judged")]
    numbers = np.stack([sample[name].to_numpy(dtype="<f8") for name in NUMBERS])
    return {
        "rows": len(sample),
        "candidates": len(candidates),
        "columns": [
            {
                "name": name,
                "label": AXES.get(name, name),
                "axis": name in AXES,
                "from": float(candidates[name].min()),
                "to": float(candidates[name].max()),
            }
            for name in NUMBERS
        ],
        "logs": logs,
        "points": points,
        "numbers": _base64(numbers),
        "codes": _base64(np.stack(codes).astype("<u2")),
        "rules": rules,
    }


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
