"""A cure for negative transfer: chosen on half of the seeds, confirmed on the other half.

The arm that looks best of many looks better than it is. So the half of the seeds that chose it has no say in how good
it is.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.agents.settings import Algorithm
from maglev_offline.streams import stream
from maglev_offline.transfer.judgement import plain
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.transfer.verdict import paired_effect


def candidates_of(settings: TransferSettings) -> list[str]:
    """The arms of the recipe that are named as cures."""
    return [name for name in dict.fromkeys(settings.arms) if settings.known_arms[name].cure]


def confirmed_cures(
    table: pd.DataFrame,
    candidates: Sequence[str],
    settings: TransferSettings,
    margins: Mapping[str, float],
    algorithms: Sequence[Algorithm],
) -> dict[str, Any]:
    """For each algorithm, the candidate with the greatest mean difference to the baseline in the primary metric.

    `table`: the metrics of every run. The first half of the seeds chooses; the rest, which holds the odd one, confirms
    by the same paired effect as everywhere. With one candidate there is nothing to choose, but the halves stay.
    """
    metric = settings.primary_metric
    found: dict[str, Any] = {"metric": metric, "candidates": list(candidates), "algorithms": {}}
    for algorithm in algorithms:
        of = table[table["algorithm"] == algorithm].pivot(index="seed", columns="arm", values=metric).sort_index()
        half = len(of) // 2
        if half < 1 or not candidates:
            continue
        choosing, confirming = of.iloc[:half], of.iloc[half:]
        looks = {arm: float((choosing[settings.baseline] - choosing[arm]).mean()) for arm in candidates}
        chosen = max(looks, key=lambda arm: (np.nan_to_num(looks[arm], nan=-np.inf), arm))
        effect = paired_effect(
            confirming[settings.baseline].to_numpy(),
            confirming[chosen].to_numpy(),
            margin=margins[metric],
            confidence=settings.confidence,
            resamples=settings.resamples,
            rng=stream(settings.seed, f"bootstrap cure {metric}"),
        )
        found["algorithms"][algorithm] = {
            "chosen": chosen,
            "choosing_seeds": [int(seed) for seed in choosing.index],
            "confirming_seeds": [int(seed) for seed in confirming.index],
            "differences_when_chosen": looks,
            "confirmed": plain(effect._asdict()),
        }
    return found
