"""The same study at other control periods, each in a workspace of its own below `periods/`."""

from pathlib import Path
from typing import Any

from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.agents.stage import World
from maglev_offline.transfer.settings import TransferSettings
from maglev_offline.workspace import Workspace

DECISIONS = ("steps", "exploratory_steps", "prefill_decay_steps")
"""Settings of training that count decisions."""


def world_at(world: World, period_ms: float, settings: TransferSettings | None = None) -> World:
    """The world with decisions every `period_ms`: as many seconds of experience, and the same horizon in seconds.

    Numbers of decisions grow as the period shrinks, and the discount is gamma^(period / the recipe's period). Replay,
    batches and networks stay as they are, so a shorter period also has more gradient steps: `settings` may ask for a
    share of the experience, which ends a run sooner, and for fewer seeds, the first ones.

    Raises
    ------
    pydantic.ValidationError: the period is no whole multiple of the plant step, or an episode holds no whole number.
    """
    ratio = world.mdp.control_period_ms / period_ms
    mdp = {"control_period_ms": period_ms, "discount": world.mdp.discount ** (1 / ratio)}
    training, evaluation = world.training.model_dump(), world.evaluation.model_dump()
    other = _scaled(training, ratio)
    if settings is not None:
        other["steps"] = max(1, round(other["steps"] * settings.other_periods_experience_share))
        other["seeds"] = min(training["seeds"], settings.other_periods_seeds or training["seeds"])
    return world._replace(
        mdp=type(world.mdp).model_validate(world.mdp.model_dump() | mdp),
        training=type(world.training).model_validate(training | other),
        evaluation=world.evaluation.model_copy(
            update={"every_steps": max(1, round(evaluation["every_steps"] * ratio))}
        ),
    )


def settings_at(settings: TransferSettings, world: World, period_ms: float) -> TransferSettings:
    """The same arms at another period; their own numbers of decisions grow with it.

    What parts of the rows do is asked at the recipe's own period alone: it would double the runs of each other one.
    """
    ratio = world.mdp.control_period_ms / period_ms
    arms = {
        name: arm.model_copy(update={"training": arm.training | _scaled(arm.training, ratio)})
        for name, arm in settings.arm.items()
    }
    return settings.model_copy(update={"arm": arms, "attribution": (), "control_periods_ms": ()})


def decays_resized(
    training: TrainingSettings, settings: TransferSettings, share: float
) -> tuple[TrainingSettings, TransferSettings]:
    """The decay of the prefill over as great a share of a run whose steps became `share` of what they were."""

    def resized(table: dict[str, Any]) -> dict[str, Any]:
        decay = table.get("prefill_decay_steps")
        return {} if decay is None else {"prefill_decay_steps": max(1, round(share * decay))}

    arms = {
        name: arm.model_copy(update={"training": arm.training | resized(arm.training)})
        for name, arm in settings.arm.items()
    }
    training = training.model_copy(update=resized(training.model_dump()))
    return training, settings.model_copy(update={"arm": arms})


def _scaled(training: dict[str, Any], ratio: float) -> dict[str, int]:
    given = {name: training[name] for name in DECISIONS if training.get(name) is not None}
    return {name: max(1, round(value * ratio)) if value else 0 for name, value in given.items()}


def workspace_at(workspace: Workspace, period_ms: float) -> Workspace:
    """The workspace of a period, which sees the samples of the one that it is in."""
    home = workspace.path("periods", f"{period_ms:g}ms")
    home.mkdir(parents=True, exist_ok=True)
    samples = home / "samples"
    if not samples.is_symlink():
        samples.symlink_to(Path("..", "..", "samples"))
    return Workspace(home, rehash=workspace.rehash)
