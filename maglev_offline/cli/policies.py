"""Commands on trained policies: policy export, policy rollout."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from maglev_offline.cli import completion
from maglev_offline.cli.options import (
    HERE,
    JsonOption,
    PlantOption,
    QuietOption,
    RecipeOption,
    Session,
    WorkspaceOption,
    on_workspace,
    open_session,
)
from maglev_offline.errors import InputError

if TYPE_CHECKING:
    from maglev_offline.policies.policy import Policy
    from maglev_offline.policies.trained import Which

AlgoOption = Annotated[
    str | None,
    typer.Option(
        "--algo",
        help="ddpg or td3. [default: the one that was trained]",
        autocompletion=completion.one_of(completion.ALGORITHMS),
    ),
]
ArmOption = Annotated[
    str | None,
    typer.Option(
        "--arm", help="empty, or prefill. [default: the one that was trained]", autocompletion=completion.arms
    ),
]
WhichOption = Annotated[
    Literal["last", "best"], typer.Option("--which", help="The actor at the end, or at the best evaluation.")
]


def add_commands(app: typer.Typer) -> None:
    """Put the group `policy` into `app`."""
    group = typer.Typer(no_args_is_help=True, rich_markup_mode="rich", help="Take trained policies out of the house.")
    group.command(epilog="Example: maglev-offline policy export --format onnx --seed 0")(on_workspace(export))
    group.command(epilog="Example: maglev-offline policy rollout --out run.mcap --seed 0 --controller policy")(
        on_workspace(rollout)
    )
    app.add_typer(group, name="policy")


def export(
    form: Annotated[
        Literal["onnx", "c", "safetensors"],
        typer.Option("--format", help="onnx (needs the extra `export`), c (one header for C99 and C++), safetensors."),
    ],
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the training.")],
    which: WhichOption = "best",
    algo: AlgoOption = None,
    arm: ArmOption = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write. [default: one here, named after the policy]")
    ] = None,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write a trained policy for use elsewhere: gap, gap velocity and current in SI units to the coil voltage in volt.

    Set-point, scales, equilibrium and voltage limit are inside, and where it comes from is in the file.
    """
    from maglev_offline.policies.export import export_policy, file_name
    from maglev_offline.policies.policy import metadata

    session = open_session(recipe, workspace, as_json, quiet, plant)
    policy = _trained(session, algo, arm, seed, which)
    path = out or Path(file_name(policy, form))
    export_policy(policy, form, path)
    origin = policy.origin
    session.talk.result(
        {"status": "done", "file": str(path), "format": form, "policy": metadata(policy)},
        f"{path}: {origin.algorithm}, arm {origin.arm}, seed {origin.seed}, {origin.which} "
        f"({path.stat().st_size / 1e3:.1f} kB); decide every {policy.mdp.control_period_ms:g} ms",
    )


def rollout(
    out: Annotated[Path, typer.Option("--out", "-o", help="MCAP file to write.")],
    controller: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            help="policy, pid, cascade, lqr, lqr_held, lqi or lqi_ekf; may be repeated.",
            autocompletion=completion.one_of(completion.CONTROLLERS),
        ),
    ] = None,
    start_gap_mm: Annotated[
        list[float] | None, typer.Option("--start-gap-mm", help="Start at rest at this gap; may be repeated.")
    ] = None,
    duration_s: Annotated[
        float | None, typer.Option("--duration-s", help="[default: an episode of the recipe]")
    ] = None,
    encoding: Annotated[
        Literal["json", "cdr", "protobuf"], typer.Option("--encoding", help="Encoding of the messages.")
    ] = "protobuf",
    at: Annotated[
        datetime, typer.Option("--at", formats=["%Y-%m-%dT%H:%M:%S"], help="When the rollout begins, UTC.")
    ] = datetime(2024, 1, 1, 8),  # where the first surrogate log begins
    policy: Annotated[
        Path | None, typer.Option("--policy", help="A policy as `policy export --format safetensors` writes it.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Seed of the training, for a trained policy.")
    ] = None,
    which: WhichOption = "best",
    algo: AlgoOption = None,
    arm: ArmOption = None,
    recipe: RecipeOption = None,
    plant: PlantOption = None,
    workspace: WorkspaceOption = HERE,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Simulate controllers, and write what they do as an MCAP log in the shape of the surrogate logs.

    Foxglove and PlotJuggler show it beside the logs; each controller is a suspension point of its own.
    """
    from maglev_offline.policies import rollout as rollouts
    from maglev_offline.policies.export import refuse_folder

    session = open_session(recipe, workspace, as_json, quiet, plant)
    drivers = list(dict.fromkeys(controller or ["policy"]))
    for name in drivers:
        if name not in rollouts.DRIVERS:
            raise InputError(
                f"there is no controller {name!r}.", where="--controller", todo=f"Give {', '.join(rollouts.DRIVERS)}."
            )
    refuse_folder(out)
    of = session.recipe
    driving = _policy(session, policy, algo, arm, seed, which) if "policy" in drivers else None
    if driving is not None:
        for difference in rollouts.other_world(driving, of.plant, of.mdp):
            session.talk.warn(f"the policy is rolled out in another world than it was trained in: {difference}.")
    scene = rollouts.Scene(of.plant, of.mdp, of.control)
    gaps = [gap / 1e3 for gap in dict.fromkeys(start_gap_mm or [1e3 * of.control.reference_start_gap_m])]
    made = rollouts.roll_out(scene, drivers, gaps, duration_s or of.mdp.episode_duration_s, driving)
    start_ns = round(at.replace(tzinfo=UTC).timestamp()) * 10**9
    topics = rollouts.write_rollouts(out, scene, made, driving, encoding=encoding, start_ns=start_ns)
    rows = rollouts.summary(scene, made)
    session.talk.table("Rollouts (simulated)", list(rollouts.COLUMNS), rollouts.table_rows(rows))
    session.talk.result(
        {"status": "done", "log": str(out), "simulated": True, "topics": topics, "responses": rows},
        f"{out}: {', '.join(topics)} ({out.stat().st_size / 1e3:.1f} kB, simulated)",
    )


def _policy(
    session: Session, file: Path | None, algo: str | None, arm: str | None, seed: int | None, which: "Which"
) -> "Policy":
    from maglev_offline.policies.tensors import load_policy

    if file is not None:
        return load_policy(file)
    if seed is None:
        raise InputError(
            "which policy is to drive is not said.", where="--controller policy", todo="Give --seed, or --policy FILE."
        )
    return _trained(session, algo, arm, seed, which)


def _trained(session: Session, algo: str | None, arm: str | None, seed: int, which: "Which") -> "Policy":
    from maglev_offline.policies.trained import trained_policy

    of = session.recipe
    return trained_policy(session.workspace, algo, arm, seed, which, of.plant, of.mdp, of.training, of.evaluation)
