"""Learning curves as the page's script draws them: small, and every run with the artefact that holds it."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from maglev_offline.report.evidence import Artefact
from maglev_offline.report.style import algorithm_label, arm_stroke, controller_stroke
from maglev_offline.streams import stream
from maglev_offline.transfer.distributions import interquartile_mean, interquartile_mean_interval
from maglev_offline.transfer.verdict import enough_seeds

DIGITS = 4
"""Significant digits of a cost on the page: no screen shows more, and the artefact has them all."""

RESAMPLES = 1_000
"""An interval at every evaluation of every arm is for the eye; those that decide have more resamples."""


def curves_data(
    curves: pd.DataFrame,
    blocks: Sequence[Artefact],
    *,
    shown: Iterable[str],
    reference: Mapping[str, float],
    threshold: float | None,
    exploratory_steps: int | None,
    confidence: float,
) -> dict[str, Any]:
    """All runs by algorithm and arm: costs [seeds][evaluations], their interquartile mean, and where they are.

    `shown`: arms that are drawn before a reader chooses; `reference`: costs of the classical controllers.
    """
    arms = list(dict.fromkeys(curves["arm"]))
    homes = _homes(blocks)
    panels = []
    for algorithm in dict.fromkeys(curves["algorithm"]):
        of, lines = curves[curves["algorithm"] == algorithm], {}
        for arm in arms:
            table = of[of["arm"] == arm].pivot(index="seed", columns="env_step", values="cost")
            if table.empty:
                continue
            rng = stream(0, f"bootstrap of the curve of {algorithm} {arm} on the page")
            cost = table.to_numpy()
            lines[arm] = _summary(cost, confidence, rng) | {
                "seeds": [int(seed) for seed in table.index],
                "blocks": [homes.get((str(algorithm), arm, int(seed)), -1) for seed in table.index],
            }
        panels.append({"name": algorithm_label(str(algorithm)), "arms": lines})
    classical = {name: controller_stroke(name) for name in reference}
    return {
        "steps": [int(step) for step in sorted(curves["env_step"].unique())],
        "exploratory": exploratory_steps or 0,
        "confidence": confidence,
        "arms": [_look(arm, arms, arm in set(shown)) for arm in arms],
        "references": [
            {"label": line.label, "colour": line.colour, "dash": _dash(line.dash), "cost": _short(reference[name])}
            for name, line in classical.items()
        ],
        "threshold": None if threshold is None else _short(threshold),
        "panels": panels,
        "blocks": [{"name": block.name, "hash": block.hash[:16]} for block in blocks],
    }


def _homes(blocks: Sequence[Artefact]) -> dict[tuple[str, str, int], int]:
    """The place in `blocks` of each algorithm, arm and seed."""
    found = {}
    for place, block in enumerate(blocks):
        algorithm, _, arm = block.folder.parent.name.partition("-")
        for seed in block.facts["seeds"]:
            found[algorithm, arm, int(seed)] = place
    return found


def _summary(cost: np.ndarray, confidence: float, rng: np.random.Generator) -> dict[str, Any]:
    """The numbers of one arm; `cost` [seeds, evaluations]. So few seeds as have no interval in a verdict have none."""
    middle = [interquartile_mean(column) for column in cost.T]
    ends = [(np.nan, np.nan)] * cost.shape[1]
    if enough_seeds(len(cost), confidence):
        ends = [interquartile_mean_interval(column, confidence, RESAMPLES, rng) for column in cost.T]
    return {
        "middle": [_short(value) for value in middle],
        "low": [_short(low) for low, _ in ends],
        "high": [_short(high) for _, high in ends],
        "runs": [[_short(value) for value in run] for run in cost],
    }


def _look(arm: str, arms: Sequence[str], shown: bool) -> dict[str, Any]:
    stroke = arm_stroke(arm, arms)
    return {
        "name": arm,
        "label": stroke.label,
        "colour": stroke.colour,
        "dash": _dash(stroke.dash),
        "shown": shown,
    }


def _dash(dash: Any) -> str:
    """A matplotlib dash as SVG writes it."""
    if isinstance(dash, str):
        return {"-": "", ":": "1 3", "--": "5 3"}[dash]
    return " ".join(f"{2 * length:g}" for length in dash[1])


def _short(value: float) -> float | None:
    """So many digits, and nothing where a run has no cost."""
    return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
