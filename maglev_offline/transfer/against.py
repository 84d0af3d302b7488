"""Arms held against each other where the recipe asks: that one beats the empty buffer and another does not is no proof
that it beats the other."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from maglev_offline.agents.settings import Algorithm
from maglev_offline.streams import stream
from maglev_offline.transfer.judgement import plain
from maglev_offline.transfer.multiple import holm
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.transfer.verdict import paired_effect


def pairs_of(settings: TransferSettings) -> list[tuple[str, str]]:
    """Each arm with each that it is to be held against."""
    return [(arm, other) for arm in dict.fromkeys(settings.arms) for other in settings.known_arms[arm].against]


def held_against(
    table: pd.DataFrame, settings: TransferSettings, margins: Mapping[str, float], algorithms: Sequence[Algorithm]
) -> dict[str, Any]:
    """The primary metric of one arm against another, paired by seed; `table`: the metrics of every run.

    A positive difference (the other minus the arm) means that the arm is better. Holm's correction goes over all pairs
    and algorithms.
    """
    metric = settings.primary_metric
    rows: list[dict[str, Any]] = []
    for algorithm in algorithms:
        of = table[table["algorithm"] == algorithm].pivot(index="seed", columns="arm", values=metric).sort_index()
        for arm, other in pairs_of(settings):
            effect = paired_effect(
                of[other].to_numpy(),
                of[arm].to_numpy(),
                margin=margins[metric],
                confidence=settings.confidence,
                resamples=settings.resamples,
                rng=stream(settings.seed, f"bootstrap against {metric}"),
            )
            rows.append({"algorithm": algorithm, "arm": arm, "against": other, **plain(effect._asdict())})
    adjusted = holm({place: row["p_value"] for place, row in enumerate(rows)})
    for place, row in enumerate(rows):
        row |= {"p_value_holm": adjusted[place], "holds_after_holm": adjusted[place] <= 1 - settings.confidence}
    return {"metric": metric, "comparisons": rows}
