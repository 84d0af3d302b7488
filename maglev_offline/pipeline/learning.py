"""What the commands on learning do: `train` and `transfer`."""

from __future__ import annotations

from typing import Any

from maglev_offline.agents.settings import Algorithm
from maglev_offline.errors import InputError
from maglev_offline.outcomes import Done
from maglev_offline.progress import Progress
from maglev_offline.recipe import Recipe
from maglev_offline.workspace import Manifest, Workspace


def algorithms(recipe: Recipe, asked: str | None) -> tuple[Algorithm, ...]:
    """The algorithms that were asked for, or those of the recipe.

    Raises
    ------
    InputError: an algorithm that is not known, or none at all.
    """
    if asked is None:
        if not recipe.training.algorithms:
            raise InputError("the recipe trains no algorithm.", where="[training] algorithms", todo="Give --algo.")
        return recipe.training.algorithms
    if asked.lower() == "ddpg":
        return ("ddpg",)
    if asked.lower() == "td3":
        return ("td3",)
    raise InputError(f"there is no algorithm {asked!r}.", where="--algo", todo="Give ddpg or td3.")


def train(
    recipe: Recipe,
    workspace: Workspace,
    asked: str | None,
    arm: str,
    jobs: int,
    progress: Progress,
    *,
    tensorboard: bool = False,
) -> Done:
    """Train one arm of the algorithms that were asked for; `tensorboard`: write event files of the evaluations too.

    Raises
    ------
    InputError: an arm that is not known, or an engine or TensorBoard that is not there.
    """
    from maglev_offline.agents import summary
    from maglev_offline.agents.events import require_tensorboard
    from maglev_offline.agents.stage import load_curves, train_arms
    from maglev_offline.transfer.arms import plan_of
    from maglev_offline.transfer.stage import arms_of

    if tensorboard:
        require_tensorboard()
    plan = plan_of(arm, recipe.transfer, recipe.curate, recipe.training)
    arms = arms_of(workspace, recipe.world, algorithms(recipe, asked), [plan], recipe.sources, jobs)
    folders, trained = train_arms(workspace, arms, recipe.world, jobs=jobs, progress=progress, tensorboard=tensorboard)
    blocks = [folder for group in folders.values() for folder in group]
    curves, facts = load_curves(blocks), [Manifest.read(folder).facts for folder in blocks]
    standings = [
        *summary.policies(curves),
        *summary.classical(recipe.plant, recipe.mdp, recipe.evaluation, recipe.control),
    ]
    lost = sum(len(fact["diverged_seeds"]) for fact in facts)
    runs = len(curves.groupby(["algorithm", "arm", "seed"]))
    return Done(
        "train",
        workspace.path("training"),
        trained > 0,
        f"{runs} runs of {recipe.training.steps:,} steps on the {facts[0]['engine']} engine "
        f"({facts[0]['instruction_set']})" + (f", {lost} of which diverged" if lost else ""),
        {
            "arms": {arm.title: [str(folder) for folder in group] for arm, group in folders.items()},
            "engine": {key: facts[0][key] for key in ("engine", "engine_why", "instruction_set", "compiler")},
            "diverged": lost,
            "standings": [standing.plain() for standing in standings],
        },
        f"Median over seeds (least..greatest); return over {len(recipe.evaluation.start_gaps_m)} starts, "
        f"settling, overshoot and bias from {recipe.evaluation.reference_start_gap_m * 1e3:g} mm",
        summary.COLUMNS,
        [standing.cells() for standing in standings],
    )


def transfer(recipe: Recipe, workspace: Workspace, jobs: int, progress: Progress, *, power: bool = False) -> Done:
    """Compare the arms, training those that are missing, at the recipe's control period and then at the others.

    `power`: say how many seeds each question needs.
    """
    from maglev_offline.transfer.stage import run_transfer
    from maglev_offline.transfer.verdict import enough_seeds
    from maglev_offline.transfer.words import (
        POWER_COLUMNS,
        answer,
        columns,
        effect_rows,
        finding_lines,
        period_lines,
        power_rows,
    )

    algorithms(recipe, None)
    folder, fresh = run_transfer(workspace, recipe.world, recipe.transfer, recipe.sources, jobs=jobs, progress=progress)
    facts = Manifest.read(folder).facts
    others = {
        f"{period:g}": _transfer_at(recipe, workspace, period, jobs, progress)
        for period in recipe.transfer.control_periods_ms
        if period != recipe.mdp.control_period_ms
    }
    if not enough_seeds(recipe.training.seeds, recipe.transfer.confidence):
        progress.warn(
            f"{recipe.training.seeds} seeds are too few for an interval at {recipe.transfer.confidence:.0%}: "
            "every verdict is inconclusive."
        )
    return Done(
        "transfer",
        folder,
        fresh,
        answer(facts),
        {"verdict": facts, "other_periods_ms": others},
        "Seeds that show a difference of the size of the margin with a power of 80 %, if they scatter as these"
        if power
        else "Empty minus arm (costs; a positive difference means that the arm's rows help)",
        POWER_COLUMNS if power else columns(recipe.transfer.confidence),
        power_rows(facts) if power else effect_rows(facts),
        notes=[*finding_lines(facts), *period_lines(others)],
    )


def _transfer_at(
    recipe: Recipe, workspace: Workspace, period_ms: float, jobs: int, progress: Progress
) -> dict[str, Any]:
    """The study at another control period; returns its facts."""
    from maglev_offline.curate.stage import curate
    from maglev_offline.transfer.periods import settings_at, workspace_at, world_at
    from maglev_offline.transfer.stage import run_transfer

    progress.say(f"the same at a control period of {period_ms:g} ms:")
    world, there = world_at(recipe.world, period_ms, recipe.transfer), workspace_at(workspace, period_ms)
    made = Manifest.read(workspace.path("transitions"))
    curate(
        there, recipe.curate, world.plant, world.mdp, pid=recipe.control.pid, cascade=recipe.control.cascade,
        folders=[there.path(name) for name in made.inputs], jobs=jobs, progress=progress,
    )  # fmt: skip
    settings = settings_at(recipe.transfer, recipe.world, period_ms)
    folder, _ = run_transfer(there, world, settings, recipe.sources, jobs=jobs, progress=progress)
    return Manifest.read(folder).facts
