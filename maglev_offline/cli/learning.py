"""Commands on the plant and on learning: control, identify, train, transfer."""

from dataclasses import replace
from typing import Annotated, Literal

import typer

from maglev_offline.cli import completion
from maglev_offline.cli.options import (
    HERE,
    AlgoOption,
    BackendOption,
    JobsOption,
    JsonOption,
    PlantOption,
    QuietOption,
    RecipeOption,
    SchedulerOption,
    Session,
    WorkspaceOption,
    on_workspace,
    open_session,
    settled,
    with_options,
)

Seeds = Annotated[int | None, typer.Option("--seeds", min=1, help="Seeds in each arm. [default: the recipe's]")]
Steps = Annotated[int | None, typer.Option("--steps", min=1, help="Decisions in a run. [default: the recipe's]")]

FailOnTransfer = Literal["never", "negative"]

EngineOption = Annotated[
    str | None,
    typer.Option(
        "--engine",
        help="auto, torch or native; auto takes native where it runs. [default: the recipe's]",
        autocompletion=completion.one_of(completion.ENGINES),
    ),
]


def add_commands(app: typer.Typer) -> None:
    """Put the commands on the plant and on learning into `app`."""
    app.command(epilog="Example: maglev-offline control --recipe pipelines/changsha.toml")(on_workspace(control))
    app.command(epilog="Example: maglev-offline identify --recipe pipelines/levitator.toml")(on_workspace(identify))
    app.command(epilog="Example: maglev-offline train --algo td3 --arm empty --seeds 4 --steps 5000")(
        on_workspace(train)
    )
    app.command(epilog="Example: maglev-offline transfer --seeds 8 --steps 5000")(on_workspace(transfer))


def _resized(session: Session, seeds: int | None, steps: int | None) -> Session:
    """The session with other numbers of seeds and steps than the recipe's.

    Exploratory steps and evaluations keep their share of the run, so that a short run has as many points on its curve.
    """
    session = with_options(session, "training", seeds=seeds)
    if steps is None:
        return session
    share = steps / session.recipe.training.steps
    explore = round(share * session.recipe.training.exploratory_steps)
    every = max(1, round(share * session.recipe.evaluation.every_steps))
    session.talk.say(f"{steps:,} steps: the first {explore:,} of them explore, and every {every:,} an evaluation.")
    session = with_options(session, "evaluation", every_steps=every)
    return _arms_resized(with_options(session, "training", steps=steps, exploratory_steps=explore), share)


def _arms_resized(session: Session, share: float) -> Session:
    """A prefill that decays does so over the same share of a run, in the recipe's training and in that of its arms."""
    from maglev_offline.transfer.periods import decays_resized

    recipe = session.recipe
    training, transfer = decays_resized(recipe.training, recipe.transfer, share)
    return replace(session, recipe=recipe.model_copy(update={"training": training, "transfer": transfer}))


def control(
    integrator: Annotated[str | None, typer.Option(help="euler or rk4.")] = None,
    plant_step_ms: Annotated[float | None, typer.Option(help="Step of the plant, ms.")] = None,
    gap_min_mm: Annotated[float | None, typer.Option(help="Upper stop, mm.")] = None,
    gap_max_mm: Annotated[float | None, typer.Option(help="Lower stop, mm.")] = None,
    voltage_limit_v: Annotated[float | None, typer.Option(help="Voltage limit about the equilibrium, V.")] = None,
    force_noise_n: Annotated[float | None, typer.Option(help="Standard deviation of a random force, N.")] = None,
    constant_load_n: Annotated[float | None, typer.Option(help="Constant load, N, downward.")] = None,
    mass_error: Annotated[float | None, typer.Option(help="Share by which the mass is heavier than believed.")] = None,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Linearise the plant; try PID, cascade PID, LQR and LQI; margins, robustness, the paper's claims; and plot it."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet, plant)
    session = with_options(
        session,
        "plant",
        gap_min_m=None if gap_min_mm is None else gap_min_mm / 1e3,
        gap_max_m=None if gap_max_mm is None else gap_max_mm / 1e3,
    )
    session = with_options(
        session, "mdp", integrator=integrator, plant_step_ms=plant_step_ms, voltage_limit_v=voltage_limit_v
    )
    session = with_options(
        session,
        "control",
        integrator=integrator,
        force_noise_std_n=force_noise_n,
        constant_load_n=constant_load_n,
        mass_error_share=mass_error,
    )
    with session.at_work("control"):
        done = pipeline.control(session.recipe, session.workspace, session.talk)
        page = pipeline.control_page(session.recipe, session.workspace)
    session.talk.table(done.title, list(done.columns), done.rows)
    session.talk.result({**done.plain(), "page": str(page)}, *done.lines(), f"  -> {page}")


def identify(
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Fit the plant's parameters to the ingested samples, and say what they can and cannot tell."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet, plant)
    with session.at_work("identify"):
        done = pipeline.identify(session.recipe, session.workspace, session.talk)
    session.talk.table(done.title, list(done.columns), done.rows)
    session.talk.result(done.plain(), *done.lines())


def train(
    algo: AlgoOption = None,
    arm: Annotated[
        str,
        typer.Option(
            "--arm",
            help="empty, prefill (start from the logged rows), or another of the recipe's arms.",
            autocompletion=completion.arms,
        ),
    ] = "empty",
    seeds: Seeds = None,
    steps: Steps = None,
    engine: EngineOption = None,
    tensorboard: Annotated[
        bool, typer.Option("--tensorboard", help="Write event files for TensorBoard (extra `tensorboard`), too.")
    ] = False,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    backend: BackendOption = "local",
    scheduler: SchedulerOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Train DDPG or TD3 over many seeds in the simulator, from an empty or a prefilled buffer."""
    from maglev_offline import pipeline

    session = _resized(open_session(recipe, settled(workspace, backend), as_json, quiet, plant), seeds, steps)
    session = with_options(session, "training", engine=engine)
    with session.spread("train", backend, scheduler, jobs) as at_once:
        done = pipeline.train(
            session.recipe, session.workspace, algo, arm, at_once, session.talk, tensorboard=tensorboard
        )
    session.talk.table(done.title, list(done.columns), done.rows)
    session.talk.result(done.plain(), *done.lines())


def transfer(
    seeds: Seeds = None,
    steps: Steps = None,
    engine: EngineOption = None,
    fail_on: Annotated[
        FailOnTransfer, typer.Option("--fail-on", help="negative: exit code 2 where an arm has negative transfer.")
    ] = "never",
    power: Annotated[
        bool, typer.Option("--power", help="Say how many seeds show the smallest effect of interest, instead.")
    ] = False,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    backend: BackendOption = "local",
    scheduler: SchedulerOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Train all arms that are missing, compare them seed by seed, and say whether prefill helps or harms.

    Exit code 2 with --fail-on negative, where an arm harms an algorithm in the recipe's primary metric.
    """
    from maglev_offline import pipeline
    from maglev_offline.transfer.words import negative_arms

    session = _resized(open_session(recipe, settled(workspace, backend), as_json, quiet, plant), seeds, steps)
    session = with_options(session, "training", engine=engine)
    with session.spread("transfer", backend, scheduler, jobs) as at_once:
        done = pipeline.transfer(session.recipe, session.workspace, at_once, session.talk, power=power)
    session.talk.table(done.title, list(done.columns), done.rows)
    session.talk.result(done.plain(), *done.lines())
    found = [done.data["verdict"], *done.data["other_periods_ms"].values()]
    if fail_on == "negative" and any(negative_arms(facts) for facts in found):
        raise typer.Exit(2)
