"""The stage: train the arms, compare them seed by seed, and say whether prefill helps or harms."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.agents.settings import Algorithm
from maglev_offline.agents.stage import Arm, World, load_curves, train_arms
from maglev_offline.control.reference import classical_reference_cost
from maglev_offline.control.settings import ControlSettings
from maglev_offline.errors import InputError
from maglev_offline.progress import SILENT, Progress
from maglev_offline.streams import stream
from maglev_offline.tables import write_parquet
from maglev_offline.transfer import metrics
from maglev_offline.transfer.arm_rows import Sources, diagnostics, prefill_of
from maglev_offline.transfer.arms import plan_of
from maglev_offline.transfer.foretelling import foretelling
from maglev_offline.transfer.multiple import holm
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.transfer.verdict import paired_effect
from maglev_offline.workspace import Manifest, Workspace, fingerprint, input_hash

Array = NDArray[np.float64]

STATISTICS = "BCa, expanded; Holm"
"""How differences are judged; part of the fingerprint, so that a verdict of another rule is judged again."""

METRICS = ("jumpstart", "asymptote", "area", "time_to_threshold")


def arms_of(
    workspace: Workspace,
    world: World,
    algorithms: Iterable[Algorithm],
    names: Iterable[str],
    settings: TransferSettings,
    sources: Sources,
) -> list[Arm]:
    """The arms of these names for these algorithms, with the prefill artefact of each made where it is missing.

    Raises
    ------
    RecipeError: an arm that is not known, or one whose own keys cannot be.
    """
    plans = [plan_of(name, settings, sources.curate, world.training) for name in dict.fromkeys(names)]
    return [
        Arm(algorithm, plan.name, prefill_of(workspace, plan, algorithm, world, sources), plan.training)
        for algorithm in dict.fromkeys(algorithms)
        for plan in plans
    ]


def run_transfer(
    workspace: Workspace,
    world: World,
    settings: TransferSettings,
    sources: Sources,
    *,
    jobs: int = 1,
    progress: Progress = SILENT,
) -> tuple[Path, bool]:
    """Make the `transfer` artefact: all curves, the metrics of each seed, and the verdict; return folder and novelty.

    Raises
    ------
    InputError: the recipe names one arm only, or an evaluation grid too coarse for its windows.
    """
    if len(set(settings.arms)) < 2 or settings.baseline not in settings.arms:
        raise InputError(
            f"a comparison needs the arm {settings.baseline!r} and another one, found {list(settings.arms)}.",
            where="[transfer] arms",
            todo='Set arms = ["empty", "prefill"].',
        )
    if not world.training.algorithms:
        raise InputError("the recipe trains no algorithm.", where="[training] algorithms", todo="Name ddpg or td3.")
    _check_windows(world, settings)
    arms = arms_of(workspace, world, world.training.algorithms, settings.arms, settings, sources)
    folders, _ = train_arms(workspace, arms, world, jobs=jobs, progress=progress)
    inputs = {f"training/{arm.title}/{folder.name}": input_hash(folder) for arm in arms for folder in folders[arm]}
    home = workspace.path("transfer")
    mark = fingerprint("transfer", inputs, settings, sources.control, *world, statistics=STATISTICS)
    if workspace.is_current(home, mark):
        return home, False

    curves = pd.concat([load_curves(folders[arm]) for arm in arms], ignore_index=True)
    table, verdict = _judged(curves, world, settings, sources.control)
    plans = [plan_of(name, settings, sources.curate, world.training) for name in settings.arms]
    verdict["rows"] = diagnostics(workspace, plans, world, sources)
    verdict["foretelling"] = foretelling(
        verdict["rows"],
        verdict["algorithms"],
        settings.primary_metric,
        settings.confidence,
        settings.resamples,
        stream(settings.seed, "bootstrap foretelling"),
    )
    manifest = Manifest("transfer", mark, inputs)
    manifest.settings = {
        "transfer": settings.model_dump(mode="json"),
        **{name: part.model_dump(mode="json") for name, part in world._asdict().items()},
    }
    manifest.counts = {"runs": len(table), "evaluations": len(curves)}
    manifest.facts = verdict
    with workspace.commit(home, manifest) as draft:
        for name, part in (("curves", curves), ("metrics", table)):
            write_parquet(part, draft / f"{name}.parquet")
    return home, True


def _judged(
    curves: pd.DataFrame, world: World, settings: TransferSettings, control: ControlSettings
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """The metrics of every run, and the verdict on every algorithm."""
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
    correct(algorithms, settings.confidence)
    for found in algorithms.values():
        for facts in found["arms"].values():
            facts["regret"] = {name: facts["mean_area"] - cost for name, cost in reference.items()}
    return table, {
        "direction": "costs: a positive difference (empty minus prefill) means that prefill helps",
        "reference_cost": reference,
        "threshold_cost": threshold,
        "primary_metric": settings.primary_metric,
        "algorithms": algorithms,
    }


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


def _check_windows(world: World, settings: TransferSettings) -> None:
    """Refuse, before hours of training, a grid of evaluations that the windows do not fit on."""
    steps, every = world.training.steps, world.evaluation.every_steps
    learned = -(-steps // every) - world.training.exploratory_steps // every
    windows = {name: getattr(settings, name) for name in ("first_evaluations", "last_evaluations", "hold_evaluations")}
    if learned < max(windows.values()):
        raise InputError(
            f"{learned} evaluations after the first gradient step are too few for "
            f"{', '.join(f'{name} = {n}' for name, n in windows.items())}.",
            where="[evaluation] every_steps",
            todo="Evaluate more often, train longer, or shorten the windows in [transfer].",
        )


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
            metric: _plain(
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


def _plain(effect: dict[str, Any]) -> dict[str, Any]:
    """NaN has no place in JSON: a number that one seed cannot give becomes null."""
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in effect.items()}
