"""What the commands on learning do: `train` and `transfer`."""

from __future__ import annotations

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
    from maglev_offline.transfer.stage import arms_of

    if tensorboard:
        require_tensorboard()
    arms = arms_of(workspace, recipe.world, algorithms(recipe, asked), [arm], recipe.transfer, recipe.sources)
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
    """Compare the arms, training those that are missing; `power`: say how many seeds each question needs."""
    from maglev_offline.transfer.stage import run_transfer
    from maglev_offline.transfer.verdict import enough_seeds
    from maglev_offline.transfer.words import POWER_COLUMNS, answer, columns, effect_rows, power_rows

    algorithms(recipe, None)
    folder, fresh = run_transfer(workspace, recipe.world, recipe.transfer, recipe.sources, jobs=jobs, progress=progress)
    facts = Manifest.read(folder).facts
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
        {"verdict": facts},
        "Seeds that show a difference of the size of the margin with a power of 80 %, if they scatter as these"
        if power
        else "Empty minus arm (costs; a positive difference means that the arm's rows help)",
        POWER_COLUMNS if power else columns(recipe.transfer.confidence),
        power_rows(facts) if power else effect_rows(facts),
    )
