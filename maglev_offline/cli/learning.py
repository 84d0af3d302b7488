"""Commands on learning: control, train, transfer."""

from typing import Annotated

import typer

from maglev_offline.cli.options import (
    HERE,
    JobsOption,
    JsonOption,
    QuietOption,
    RecipeOption,
    Session,
    WorkspaceOption,
    cores,
    open_session,
    with_options,
)

Seeds = Annotated[int | None, typer.Option("--seeds", min=1, help="Seeds in each arm. [default: the recipe's]")]
Steps = Annotated[int | None, typer.Option("--steps", min=1, help="Decisions in a run. [default: the recipe's]")]


def add_commands(app: typer.Typer) -> None:
    """Put the commands on learning into `app`."""
    app.command(epilog="Example: maglev-offline control --recipe pipelines/changsha.toml")(control)
    app.command(epilog="Example: maglev-offline train --algo td3 --arm empty --seeds 4 --steps 5000")(train)
    app.command(epilog="Example: maglev-offline transfer --seeds 8 --steps 5000")(transfer)


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
    return with_options(session, "training", steps=steps, exploratory_steps=explore)


def control(
    recipe: RecipeOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Linearise the plant, and try PID, cascade PID, LQR and LQI from several gaps."""
    from maglev_offline import pipeline

    session = open_session(recipe, workspace, as_json, quiet)
    with session.at_work("control"):
        done = pipeline.control(session.recipe, session.workspace, session.talk)
    session.talk.table(done.title, list(done.columns), done.rows)
    session.talk.result(done.plain(), *done.lines())


def train(
    algo: Annotated[str | None, typer.Option("--algo", help="ddpg or td3. [default: those of the recipe]")] = None,
    arm: Annotated[str, typer.Option("--arm", help="empty, or prefill: start from the logged rows.")] = "empty",
    seeds: Seeds = None,
    steps: Steps = None,
    recipe: RecipeOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Train DDPG or TD3 over many seeds in the simulator, from an empty or a prefilled buffer."""
    from maglev_offline import pipeline

    session = _resized(open_session(recipe, workspace, as_json, quiet), seeds, steps)
    with session.at_work("train"):
        done = pipeline.train(session.recipe, session.workspace, algo, arm, cores(jobs), session.talk)
    session.talk.table(done.title, list(done.columns), done.rows)
    session.talk.result(done.plain(), *done.lines())


def transfer(
    seeds: Seeds = None,
    steps: Steps = None,
    recipe: RecipeOption = None,
    workspace: WorkspaceOption = HERE,
    jobs: JobsOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Train all arms that are missing, compare them seed by seed, and say whether prefill helps or harms."""
    from maglev_offline import pipeline

    session = _resized(open_session(recipe, workspace, as_json, quiet), seeds, steps)
    with session.at_work("transfer"):
        done = pipeline.transfer(session.recipe, session.workspace, cores(jobs), session.talk)
    session.talk.table(done.title, list(done.columns), done.rows)
    session.talk.result(done.plain(), *done.lines())
