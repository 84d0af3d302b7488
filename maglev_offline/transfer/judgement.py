"""The curves of all arms to the metrics of every run, and to effects against the baseline."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from maglev_offline.agents.settings import Algorithm
from maglev_offline.agents.stage import World
from maglev_offline.control.reference import classical_reference_cost
from maglev_offline.control.settings import ControlSettings
from maglev_offline.streams import stream
from maglev_offline.transfer import metrics
from maglev_offline.transfer.multiple import holm
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.transfer.verdict import paired_effect

METRICS = ("jumpstart", "asymptote", "area", "time_to_threshold")


class Judgement(NamedTuple):
    """The metrics of every run (a table), the margin of each metric, and the facts: the verdict on every algorithm.

    Effects of arms that the recipe does not name (those of an attribution) are apart, in `others`.
    """

    table: pd.DataFrame
    margins: dict[str, float]
    facts: dict[str, Any]
    others: dict[Algorithm, dict[str, Any]]


def judge_curves(curves: pd.DataFrame, world: World, settings: TransferSettings, control: ControlSettings) -> Judgement:
    """Judge the curves of all arms: their metrics, and every arm against the baseline, paired by seed."""
    reference = {
        name: float(np.mean(cost))
        for name, cost in classical_reference_cost(
            world.plant, world.mdp, world.evaluation.start_gaps_m, settings=control
        ).items()
    }
    threshold = settings.threshold_over_lqr * reference["lqr_held"]
    table = seed_metrics(curves, world, settings, threshold)
    margins = dict.fromkeys(METRICS, settings.equivalence_share * reference["lqr_held"])
    margins["time_to_threshold"] = settings.equivalence_share * world.training.steps
    algorithms = {
        algorithm: compare(table[table["algorithm"] == algorithm], settings, margins)
        for algorithm in world.training.algorithms
    }
    others: dict[Algorithm, dict[str, Any]] = {
        algorithm: {
            "effects": {arm: found["effects"].pop(arm) for arm in [*found["effects"]] if arm not in settings.arms}
        }
        for algorithm, found in algorithms.items()
    }
    correct(algorithms, settings.confidence)
    for found in algorithms.values():
        for facts in found["arms"].values():
            facts["regret"] = {name: facts["mean_area"] - cost for name, cost in reference.items()}
    facts = {
        "direction": "costs: a positive difference (empty minus arm) means that the arm's rows help",
        "reference_cost": reference,
        "threshold_cost": threshold,
        "primary_metric": settings.primary_metric,
        "arms": list(dict.fromkeys(settings.arms)),
        "algorithms": algorithms,
    }
    return Judgement(table, margins, facts, others)


def correct(algorithms: Mapping[Algorithm, dict[str, Any]], confidence: float) -> None:
    """Add to every effect its p-value after Holm's correction over all algorithms, arms and metrics of the study."""
    effects = {
        (algorithm, arm, metric): effect
        for algorithm, found in algorithms.items()
        for arm, metrics_of in found["effects"].items()
        for metric, effect in metrics_of.items()
    }
    adjusted = holm({key: effect["p_value"] for key, effect in effects.items()})
    for key, effect in effects.items():
        effect["p_value_holm"] = adjusted[key]
        effect["holds_after_holm"] = adjusted[key] <= 1 - confidence


def seed_metrics(curves: pd.DataFrame, world: World, settings: TransferSettings, threshold: float) -> pd.DataFrame:
    """All metrics of all runs, one row for algorithm, arm and seed. A run that diverged keeps its (bad) costs."""
    rows = []
    for (algorithm, arm), group in curves.groupby(["algorithm", "arm"], sort=False):
        costs = group.pivot(index="seed", columns="env_step", values="cost")
        steps, cost = costs.columns.to_numpy(np.int64), costs.to_numpy()
        learned = steps > world.training.exploratory_steps
        time = metrics.time_to_threshold(steps, cost, threshold, settings.hold_evaluations)
        last = group[group["env_step"] == steps[-1]].set_index("seed").loc[costs.index]
        rows.append(
            pd.DataFrame(
                {
                    "algorithm": algorithm,
                    "arm": arm,
                    "seed": costs.index.to_numpy(),
                    "jumpstart": metrics.jumpstart(cost[:, learned], settings.first_evaluations),
                    "asymptote": metrics.asymptote(cost, settings.last_evaluations),
                    "area": metrics.area(steps, cost),
                    "time_to_threshold": time.steps,
                    "reached": time.reached,
                    "drift": metrics.drift(steps, cost, settings.last_evaluations),
                    "final_worst_error_m": last["worst_error_m"].to_numpy(),
                    "final_settling_time_s": last["settling_time_s"].to_numpy(),
                    "diverged": last["diverged"].to_numpy(),
                }
            )
        )
    return pd.concat(rows, ignore_index=True)


def compare(table: pd.DataFrame, settings: TransferSettings, margins: Mapping[str, float]) -> dict[str, Any]:
    """Compare every arm of one algorithm with the baseline, paired by seed; `margins` by metric, in its own unit."""
    arms = {arm: group.set_index("seed").sort_index() for arm, group in table.groupby("arm", sort=False)}
    base = arms[settings.baseline]
    found: dict[str, Any] = {"arms": {arm: _arm_facts(group) for arm, group in arms.items()}, "effects": {}}
    for arm, group in arms.items():
        if arm == settings.baseline:
            continue
        found["effects"][arm] = {
            metric: plain(
                paired_effect(
                    base[metric].to_numpy(),
                    group.loc[base.index, metric].to_numpy(),
                    margin=margins[metric],
                    confidence=settings.confidence,
                    resamples=settings.resamples,
                    rng=stream(settings.seed, f"bootstrap {metric}"),
                )._asdict()
            )
            for metric in METRICS
        }
    return found


def _arm_facts(group: pd.DataFrame) -> dict[str, Any]:
    return {
        "seeds": len(group),
        "share_reached": float(group["reached"].mean()),
        "share_within_half_mm": float((group["final_worst_error_m"] <= 0.5e-3).mean()),
        "share_settled": float(group["final_settling_time_s"].notna().mean()),
        "median_final_worst_error_m": float(group["final_worst_error_m"].median()),
        "mean_area": float(group["area"].mean()),
        "mean_drift": float(group["drift"].mean()),
        "diverged": int(group["diverged"].sum()),
    }


def plain(effect: dict[str, Any]) -> dict[str, Any]:
    """NaN has no place in JSON: a number that one seed cannot give becomes null."""
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in effect.items()}
