"""The stage: train the arms, compare them seed by seed, and say whether prefill helps or harms."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from maglev_offline.agents.settings import Algorithm
from maglev_offline.agents.stage import Arm, World, load_curves, train_arms
from maglev_offline.errors import InputError
from maglev_offline.progress import SILENT, Progress
from maglev_offline.replay.prefill import read_transitions
from maglev_offline.streams import stream
from maglev_offline.tables import write_parquet
from maglev_offline.transfer.against import held_against, pairs_of
from maglev_offline.transfer.arm_rows import Sources, facts_of_rows, prefill_of, transitions_of
from maglev_offline.transfer.arms import Plan, plan_of
from maglev_offline.transfer.attribution import Part, attribute, parts_of, plan_without
from maglev_offline.transfer.cure import candidates_of, confirmed_cures
from maglev_offline.transfer.foretelling import foretelling
from maglev_offline.transfer.judgement import Judgement, judge_curves
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.transfer.verdict import enough_seeds
from maglev_offline.workspace import Manifest, Workspace, fingerprint, input_hash

STATISTICS = "BCa, expanded; Holm of exact signs; foretold by groups"
"""How differences are judged; part of the fingerprint, so that a verdict of another rule is judged again."""


def arms_of(
    workspace: Workspace,
    world: World,
    algorithms: Iterable[Algorithm],
    plans: Iterable[Plan],
    sources: Sources,
    jobs: int = 1,
) -> list[Arm]:
    """The arms of these plans for these algorithms, with the prefill artefact of each made where it is missing."""
    plans = list(plans)
    return [
        Arm(algorithm, plan.name, prefill_of(workspace, plan, algorithm, world, sources, jobs), plan.training)
        for algorithm in dict.fromkeys(algorithms)
        for plan in plans
    ]


def _parts(
    workspace: Workspace, plans: list[Plan], world: World, settings: TransferSettings, sources: Sources, jobs: int
) -> tuple[Plan, list[Part]] | None:
    """The arm whose rows are parted, and the parts, where the recipe asks for it."""
    if not settings.attribution:
        return None
    whole = next(plan for plan in plans if plan.name == settings.attributed)
    table = read_transitions(transitions_of(workspace, whole, world, sources, jobs))
    return whole, parts_of(table, settings.attribution, world.mdp)


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
    plans = [plan_of(name, settings, sources.curate, world.training) for name in dict.fromkeys(settings.arms)]
    parted = _parts(workspace, plans, world, settings, sources, jobs)
    if parted is not None:
        plans += [plan_without(part, parted[0], sources.curate) for part in parted[1]]
    if len(plans) > 2:
        progress.say(
            f"transfer: {len(plans)} arms, {len(plans) - len(settings.arms)} of them to attribute; first their rows."
        )
    arms = arms_of(workspace, world, world.training.algorithms, plans, sources, jobs)
    folders, _ = train_arms(workspace, arms, world, jobs=jobs, progress=progress)
    inputs = {f"training/{arm.title}/{folder.name}": input_hash(folder) for arm in arms for folder in folders[arm]}
    home = workspace.path("transfer")
    mark = fingerprint("transfer", inputs, settings, sources.control, *world, statistics=STATISTICS)
    if workspace.is_current(home, mark):
        return home, False

    curves = pd.concat([load_curves(folders[arm]) for arm in arms], ignore_index=True)
    judged = judge_curves(curves, world, settings, sources.control)
    facts = judged.facts | {"rows": facts_of_rows(workspace, plans, world, sources)}
    _tell(facts, settings, world, progress)
    facts |= _asked_for(judged, settings, world.training.algorithms, parted)
    facts["foretelling"] = _foretold(facts, judged, settings)
    manifest = Manifest("transfer", mark, inputs)
    manifest.settings = {
        "transfer": settings.model_dump(mode="json"),
        **{name: part.model_dump(mode="json") for name, part in world._asdict().items()},
    }
    manifest.counts = {"runs": len(judged.table), "evaluations": len(curves)}
    manifest.facts = facts
    with workspace.commit(home, manifest) as draft:
        for name, part in (("curves", curves), ("metrics", judged.table)):
            write_parquet(part, draft / f"{name}.parquet")
    return home, True


def _asked_for(
    judged: Judgement,
    settings: TransferSettings,
    algorithms: Sequence[Algorithm],
    parted: tuple[Plan, list[Part]] | None,
) -> dict[str, Any]:
    """The findings that the recipe asks for beside the effects: cures, arms against each other, parts of the rows."""
    found, cures = {}, candidates_of(settings)
    table, margins = judged.table, judged.margins
    if cures:
        found["cure"] = confirmed_cures(table, cures, settings, margins, algorithms)
    if pairs_of(settings):
        found["against"] = held_against(table, settings, margins, algorithms)
    if parted is not None:
        whole, parts = parted
        found["attribution"] = attribute(table, parts, whole.name, settings, margins, algorithms)
    return found


def _tell(facts: Mapping[str, Any], settings: TransferSettings, world: World, progress: Progress) -> None:
    """Warn of arms that had fewer rows than others, and of cures that too few seeds are left to confirm."""
    most = max((found["rows"] for found in facts["rows"].values()), default=0)
    fewer = [f"{arm} ({found['rows']:,})" for arm, found in facts["rows"].items() if found["rows"] < most]
    if fewer:
        progress.warn(
            f"arms with fewer rows than the {most:,} of others, which is a difference too: {', '.join(fewer)}."
        )
    confirming = world.training.seeds - world.training.seeds // 2
    if candidates_of(settings) and not enough_seeds(confirming, settings.confidence):
        progress.warn(
            f"{confirming} seeds that confirm a cure are too few for an interval at {settings.confidence:.0%}: no cure "
            "can be confirmed."
        )


def _foretold(facts: dict[str, Any], judged: Judgement, settings: TransferSettings) -> dict[str, Any]:
    """What the diagnostic foretold over all arms, those of the attribution included."""
    effects = {
        algorithm: {"effects": found["effects"] | judged.others[algorithm]["effects"]}
        for algorithm, found in facts["algorithms"].items()
    }
    rng = stream(settings.seed, "bootstrap foretelling")
    groups = {arm: found["artefact"] for arm, found in facts["rows"].items()}
    # What is left of the attributed arm's rows without a part of them is no other log.
    groups |= {arm: groups[settings.attributed] for arm in groups if arm not in settings.arms}
    rows, metric = facts["rows"], settings.primary_metric
    return foretelling(rows, effects, metric, settings.confidence, settings.resamples, rng, groups)


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
