"""Which part of the rows helps or harms: arms from which one part is left out, against the arm that has it.

The rest is balanced anew to as many rows, so that an arm without a part has as many as the arm with it, where there are
enough. What is left out is named by a rule of `[[curate.exclude]]`, which an operator can put into a recipe.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from maglev_offline.agents.settings import Algorithm
from maglev_offline.curate.rules import Rule, fits
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.mdp import Mdp
from maglev_offline.streams import stream
from maglev_offline.transfer.arms import Plan
from maglev_offline.transfer.judgement import plain
from maglev_offline.transfer.multiple import holm
from maglev_offline.transfer.settings import AttributionKind, TransferSettings
from maglev_offline.transfer.verdict import paired_effect

BEYOND = 1e6
"""In SI units, farther than any state or cost lies: the end of a range that has none."""

LEAST_SHARE = 0.01
"""A cell with fewer of the rows is no part: what so few rows do cannot be seen."""

BANDS = 4
CUT_SCALES = 0.5
"""Cells are cut at this share of a state scale on either side of the set-point and of rest."""

MEANING = {"positive": "harms", "negative": "helps", "equivalent": "does not matter", "inconclusive": "not known"}
"""What it says of a part that leaving it out is so."""


class Part(NamedTuple):
    """A part of the rows: its kind and name, the rule that names its rows, and its share of the curated ones."""

    kind: AttributionKind
    name: str
    rule: Rule
    share: float


def parts_of(table: pd.DataFrame, kinds: Sequence[AttributionKind], mdp: Mdp) -> list[Part]:
    """Part a table of curated transitions by log, by cell of gap error and velocity (3 x 3), or by quartile of cost."""
    makers = {"logs": _logs, "cells": _cells, "cost_bands": _cost_bands}
    found = []
    for kind in dict.fromkeys(kinds):
        for name, rule in makers[kind](table, mdp):
            share = float(fits(table, rule).mean())
            if LEAST_SHARE <= share < 1:
                found.append(Part(kind, name, rule, share))
    return found


def _logs(table: pd.DataFrame, _mdp: Mdp) -> list[tuple[str, Rule]]:
    logs = sorted(table["log_id"].unique())
    return [(f"log-{number + 1}", Rule(log_id=(log,))) for number, log in enumerate(logs)]


def _cells(_table: pd.DataFrame, mdp: Mdp) -> list[tuple[str, Rule]]:
    gap, velocity = CUT_SCALES * mdp.gap_scale_m, CUT_SCALES * mdp.velocity_scale_m_s
    gaps = {"near": (-BEYOND, -gap), "at-rest": (-gap, gap), "far": (gap, BEYOND)}
    velocities = {"closing": (-BEYOND, -velocity), "still": (-velocity, velocity), "opening": (velocity, BEYOND)}
    return [
        (f"cell-{place}-{motion}", Rule(gap_error_m=at, gap_velocity_m_s=moving))
        for place, at in gaps.items()
        for motion, moving in velocities.items()
    ]


def _cost_bands(table: pd.DataFrame, _mdp: Mdp) -> list[tuple[str, Rule]]:
    edges = [float(edge) for edge in np.quantile(table["cost"], np.arange(1, BANDS) / BANDS)]
    ends = [-BEYOND, *edges, BEYOND]
    return [(f"cost-{k + 1}-of-{BANDS}", Rule(cost=(ends[k], ends[k + 1]))) for k in range(BANDS)]


def plan_without(part: Part, whole: Plan, curate: CurateSettings) -> Plan:
    """The arm `whole` without a part; `curate`: the recipe's table, where the arm has none of its own."""
    own = whole.curate or curate
    return Plan(
        f"{whole.name}-without-{part.name}",
        whole.rows,
        own.model_copy(update={"exclude": (*own.exclude, part.rule)}),
        whole.training,
    )


def attribute(
    table: pd.DataFrame,
    parts: Sequence[Part],
    whole: str,
    settings: TransferSettings,
    margins: Mapping[str, float],
    algorithms: Sequence[Algorithm],
) -> dict[str, Any]:
    """Hold each arm without a part against the arm `whole`, paired by seed, in the primary metric.

    `table`: the metrics of every run. A positive difference (whole minus without) means that it is better without the
    part: the part harms. Holm's correction goes over all parts and algorithms.
    """
    metric = settings.primary_metric
    rows: list[dict[str, Any]] = []
    p_values: dict[int, float] = {}
    for algorithm in algorithms:
        of = table[table["algorithm"] == algorithm].pivot(index="seed", columns="arm", values=metric)
        for part in parts:
            effect = paired_effect(
                of[whole].to_numpy(),
                of[f"{whole}-without-{part.name}"].to_numpy(),
                margin=margins[metric],
                confidence=settings.confidence,
                resamples=settings.resamples,
                rng=stream(settings.seed, f"bootstrap attribution {metric}"),
            )
            p_values[len(rows)] = effect.p_value
            rows.append(
                {
                    "algorithm": algorithm,
                    "kind": part.kind,
                    "part": part.name,
                    "rule": part.rule.model_dump(mode="json", exclude_none=True),
                    "share_of_rows": part.share,
                    "meaning": MEANING[effect.verdict],
                    **plain(effect._asdict()),
                }
            )
    adjusted = holm(p_values)
    for number, row in enumerate(rows):
        row |= {"p_value_holm": adjusted[number], "holds_after_holm": adjusted[number] <= 1 - settings.confidence}
    return {"of": whole, "metric": metric, "parts": rows}
