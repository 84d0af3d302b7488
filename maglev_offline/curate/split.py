"""Training and validation: whole logs, never rows, since neighbouring rows of a log are all but the same."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from maglev_offline.streams import stream

if TYPE_CHECKING:
    import pandas as pd


def split_of(log_id: pd.Series, validation_share: float, seed: int, logs: Collection[str] | None = None) -> pd.Series:
    """`train` or `validation` for each row, by its log.

    The nearest whole number of logs is held out, chosen by the seed; one log at least remains for training. `logs`: all
    that there are, where some of them have no row left: which logs are held out must not depend on what a rule takes.
    """
    here = set(log_id.unique())
    logs = np.sort(list(here if logs is None else here | set(logs)))
    count = min(round(validation_share * len(logs)), len(logs) - 1)
    held_out = stream(seed, "curate: split").permutation(logs)[:count]
    if here <= set(held_out):  # rules left nothing else: then it is for training
        held_out = held_out[:0]
    return log_id.isin(held_out).map({True: "validation", False: "train"})
