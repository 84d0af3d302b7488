"""The rows in the page: a seeded sample of the candidates, packed so that the page sees the very numbers of the table.

Numbers are float64, since a rule is held against them, and both ends of its ranges are included: a gap of 0.1 mm, as
sensors write it, must lie in a range up to 0.1 mm in the page as it does in `curate`.
"""

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.curate.diagnostic import FIT_ERROR, HARMFUL_ERROR
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
    return pd.read_parquet(folder / "candidates.parquet", columns=[*KEY, *NUMBERS, "split"])


def sample_of(candidates: pd.DataFrame, folder: Path, seed: int, most: int = MOST_ROWS) -> pd.DataFrame:
    """Draw at most `most` candidates, in their order, with the columns `state` and `judged` (codes, see above).

    Rows that were judged are taken first among those for training. They are a uniform draw of them, so the sample is
    uniform, too: a share of the sample estimates the share of the candidates.
    """
    judged = pd.read_parquet(folder / "diagnostic_rows.parquet", columns=[*KEY, "advantage", "taught_advantage"])
    spread = judged["advantage"].std(ddof=0)
    error = (judged["taught_advantage"] - judged["advantage"]).abs()
    judged = judged[KEY].assign(error=error / spread if spread > 0 else np.nan)
    rows = candidates.merge(judged, on=KEY, how="left", validate="one_to_one")
    chosen = rows.iloc[_chosen(rows, seed, most)].reset_index(drop=True)
    taken = pd.read_parquet(folder / "transitions.parquet", columns=KEY).assign(taken=True)
    curated = chosen.merge(taken, on=KEY, how="left")["taken"].notna().to_numpy()
    state = np.where(curated, CURATED, np.where(chosen["split"] == "train", NOT_SELECTED, HELD_OUT))
    ratio = chosen.pop("error").to_numpy()
    degree = np.where(ratio <= FIT_ERROR, TRUE, np.where(ratio < HARMFUL_ERROR, BETWEEN, FALSE))
    return chosen.assign(state=state, judged=np.where(np.isnan(ratio), NOT_JUDGED, degree))


def _chosen(rows: pd.DataFrame, seed: int, most: int) -> np.ndarray:
    """Places of the sample in `rows`, in rising order."""
    if len(rows) <= most:
        return np.arange(len(rows))
    order = stream(seed, "card: sample").permutation(len(rows))
    training = (rows["split"] == "train").to_numpy()[order]
    judged = rows["error"].notna().to_numpy()[order]
    of_training = round(most * training.mean())
    first = np.concatenate([order[training & judged], order[training & ~judged]])[:of_training]
    return np.sort(np.concatenate([first, order[~training][: most - of_training]]))


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
