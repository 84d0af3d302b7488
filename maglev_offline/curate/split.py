"""Training and validation: whole logs, never rows, since neighbouring rows of a log are all but the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from maglev_offline.streams import stream

if TYPE_CHECKING:
    import pandas as pd


def split_of(log_id: pd.Series, validation_share: float, seed: int) -> pd.Series:
    """`train` or `validation` for each row, by its log.

    The nearest whole number of logs is held out, chosen by the seed; one log at least remains for training.
    """
    logs = np.sort(log_id.unique())
    count = min(round(validation_share * len(logs)), len(logs) - 1)
    held_out = stream(seed, "curate: split").permutation(logs)[:count]
    return log_id.isin(held_out).map({True: "validation", False: "train"})
