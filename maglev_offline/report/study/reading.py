"""What the figures of a study have in common: its arms in order of merit, and paired differences run by run."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.report.evidence import Artefact
from maglev_offline.report.figures_learning import METRIC_LABELS
from maglev_offline.report.style import arm_stroke

Facts = Mapping[str, Any]

BASELINE = "empty"


def runs_of(study: Artefact) -> pd.DataFrame:
    """The metrics of every run: one row for algorithm, arm and seed."""
    return pd.read_parquet(study.folder / "metrics.parquet")


def metric_label(facts: Facts) -> str:
    """The primary metric, as readers call it."""
    metric = str(facts["primary_metric"])
    return METRIC_LABELS.get(metric, metric)


def metric_unit(facts: Facts) -> str:
    """What the primary metric is counted in."""
    return "steps" if facts["primary_metric"] == "time_to_threshold" else "cost"


def arm_label(facts: Facts, arm: str) -> str:
    """What an arm is called, here as in the other figures."""
    return arm_stroke(arm, facts["arms"]).label


def primary_effects(facts: Facts, algorithm: str) -> dict[str, Facts]:
    """Effects of the recipe's arms in the primary metric: greatest mean difference first, those without one last.

    Of equal ones, the first in the recipe is first.
    """
    found = facts["algorithms"][algorithm]["effects"]
    effects = {arm: found[arm][facts["primary_metric"]] for arm in facts["arms"] if arm in found}
    return dict(sorted(effects.items(), key=lambda item: -_size(item[1]["difference"])))


def _size(difference: float | None) -> float:
    return -np.inf if difference is None else difference


def paired_differences(runs: pd.DataFrame, algorithm: str, metric: str) -> pd.DataFrame:
    """Baseline minus arm, paired by seed: a row for each seed, a column for each arm but the baseline."""
    table = runs[runs["algorithm"] == algorithm].pivot(index="seed", columns="arm", values=metric).sort_index()
    others = [arm for arm in table.columns if arm != BASELINE]
    return table[others].rsub(table[BASELINE], axis=0)


def seeds_of(facts: Facts) -> int:
    """The greatest number of seeds that an arm has."""
    return max((arm["seeds"] for found in facts["algorithms"].values() for arm in found["arms"].values()), default=0)
