"""The rows that an arm's buffer starts with, as artefacts below `arms/<name>/`, judged before anything is trained."""

from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from maglev_offline.agents.settings import Algorithm
from maglev_offline.agents.stage import World
from maglev_offline.control.feedback import Controller
from maglev_offline.control.pid import pid
from maglev_offline.control.settings import ControlSettings
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.errors import ArtefactError
from maglev_offline.replay.prefill import fitting_transitions, make_prefill, read_transitions
from maglev_offline.replay.settings import PrefillSettings
from maglev_offline.settings import Settings
from maglev_offline.streams import stream
from maglev_offline.tables import write_parquet
from maglev_offline.transfer.arms import Plan
from maglev_offline.workspace import Manifest, Workspace, fingerprint, input_hash


class Sources(NamedTuple):
    """The recipe's tables that the rows of arms depend on, beside the world."""

    curate: CurateSettings
    prefill: PrefillSettings
    control: ControlSettings


def prefill_of(
    workspace: Workspace, plan: Plan, algorithm: Algorithm, world: World, sources: Sources, jobs: int = 1
) -> Path | None:
    """The prefill artefact of an arm, made where it is missing; None where the buffer starts empty.

    Raises
    ------
    ArtefactError: there are no curated transitions in the workspace to take rows or their number from.
    """
    if plan.rows == "nothing":
        return None
    if plan.rows == "log" and plan.curate is None:
        return make_prefill(workspace, algorithm, sources.prefill, world.plant, world.mdp)[0]
    rows = transitions_of(workspace, plan, world, sources, jobs)
    home = workspace.path("arms", plan.name, algorithm)
    return make_prefill(workspace, algorithm, sources.prefill, world.plant, world.mdp, source=rows, home=home)[0]


def transitions_of(workspace: Workspace, plan: Plan, world: World, sources: Sources, jobs: int = 1) -> Path:
    """The transitions of an arm that has rows.

    Raises
    ------
    ArtefactError: there are no curated transitions, or they were made with other tables than the arm goes by.
    """
    base = workspace.path("transitions")
    made = fitting_transitions(base, world.plant, world.mdp)
    if plan.curate is not None:
        _refuse_other_tables(base, made, plan.name, sources)
        base = _curated(workspace, plan.curate, base, world, sources, jobs)
    if plan.rows == "log":
        return base
    return _made(workspace, plan, base, world, sources)


def _refuse_other_tables(base: Path, made: Manifest, arm: str, sources: Sources) -> None:
    """Refuse to curate an arm by the recipe beside rows that were curated by another [curate]."""
    wanted: dict[str, Settings] = {
        "curate": sources.curate, "pid": sources.control.pid, "cascade": sources.control.cascade
    }  # fmt: skip
    other = [name for name, table in wanted.items() if made.settings.get(name) != table.model_dump(mode="json")]
    if other:
        raise ArtefactError(
            f"the transitions were curated with another {', '.join(f'[{name}]' for name in other)} than this recipe "
            f"has, so the arm {arm!r} could not be held against the others.",
            where=str(base),
            todo="Run `maglev-offline curate` with this recipe first.",
        )


def _curated(
    workspace: Workspace, settings: CurateSettings, recipes: Path, world: World, sources: Sources, jobs: int
) -> Path:
    """Transitions curated otherwise than the recipe's own (`recipes`), from the same samples.

    Their folder is named by the table, so that arms which differ in training only share it.
    """
    from maglev_offline.curate.stage import curate

    name = f"{settings.construction}-{fingerprint('arm', {}, settings)[:8]}"
    folder, _ = curate(
        workspace,
        settings,
        world.plant,
        world.mdp,
        pid=sources.control.pid,
        cascade=sources.control.cascade,
        folders=[workspace.path(sample) for sample in Manifest.read(recipes).inputs],
        home=workspace.path("curated", name),
        jobs=jobs,
    )
    return folder


def _made(workspace: Workspace, plan: Plan, base: Path, world: World, sources: Sources) -> Path:
    """Rows that are made here, as many as `base` has."""
    inputs = {base.relative_to(workspace.root).as_posix(): input_hash(base)}
    home = workspace.path("arms", plan.name, "transitions")
    # A random policy holds its actions for as long as the agents do that explore.
    hold_ms, seed = world.training.exploratory_hold_ms, sources.curate.seed
    mark = fingerprint(
        "arm rows", inputs, world.plant, world.mdp, sources.control, rows=plan.rows, hold_ms=hold_ms, seed=seed
    )
    if workspace.is_current(home, mark):
        return home
    curated = read_transitions(base)
    table = shuffled(curated, seed) if plan.rows == "shuffled" else _simulated(plan, len(curated), world, sources)
    manifest = Manifest(f"arms/{plan.name}/transitions", mark, inputs)
    tables = {"plant": world.plant, "mdp": world.mdp, "control": sources.control}
    manifest.settings = {name: part.model_dump(mode="json") for name, part in tables.items()}
    manifest.counts = {"transitions": len(table)}
    manifest.facts = {"construction": plan.rows}
    with workspace.commit(home, manifest) as draft:
        write_parquet(table, draft / "transitions.parquet")
    return home


def _simulated(plan: Plan, rows: int, world: World, sources: Sources) -> pd.DataFrame:
    from maglev_offline.transfer.simulated_rows import RandomPolicy, simulated_rows

    mdp, seed = world.mdp, sources.curate.seed
    policy: Controller = pid(sources.control.pid, mdp.voltage_limit_v)
    if plan.rows == "random_policy":
        hold = max(1, round(world.training.exploratory_hold_ms / mdp.control_period_ms))
        policy = RandomPolicy(stream(seed, "random policy: actions"), mdp.voltage_limit_v, hold)
    return simulated_rows(world.plant, mdp, policy, rows, plan.rows, seed)


def shuffled(table: pd.DataFrame, seed: int) -> pd.DataFrame:
    """The rows, each with the voltage of another one: the same states, costs and voltages, and nothing to learn."""
    order = stream(seed, "shuffled actions").permutation(len(table))
    voltage = table["voltage_deviation_v"].to_numpy()[order]
    return table.assign(voltage_deviation_v=voltage, origin="shuffled")


def facts_of_rows(workspace: Workspace, plans: list[Plan], world: World, sources: Sources) -> dict[str, dict[str, Any]]:
    """What each arm's buffer starts with, and what the diagnostic says of those rows; arms without are left out."""
    from maglev_offline.curate.diagnostic import diagnose

    found = {}
    for plan in plans:
        if plan.rows == "nothing":
            continue
        folder = transitions_of(workspace, plan, world, sources)
        table = read_transitions(folder)
        found[plan.name] = {
            "rows_from": plan.rows,
            "artefact": folder.relative_to(workspace.root).as_posix(),
            "rows": len(table),
            "construction": Manifest.read(folder).facts.get("construction"),
            "diagnostic": diagnose(table, world.plant, world.mdp, sources.curate.seed).plain(),
        }
    return found
