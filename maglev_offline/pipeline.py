"""The stages joined: what each command of the command line does.

A stage is imported by the command that runs it: a second run on unchanged logs is over sooner than pandas is imported.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

from maglev_offline.agents.settings import Algorithm
from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.filesystems import Where
from maglev_offline.outcomes import Done, Ingested, Run
from maglev_offline.progress import Progress
from maglev_offline.recipe import Recipe
from maglev_offline.transfer.settings import ArmName
from maglev_offline.workspace import Manifest, Workspace

if TYPE_CHECKING:
    from maglev_offline.replay.exports.stage import Name as ExportForm


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


def ingest(
    recipe: Recipe,
    workspace: Workspace,
    logs: Sequence[Where],
    jobs: int,
    progress: Progress,
    *,
    only: bool = False,
    merge: bool = False,
) -> Ingested:
    """Ingest logs, then curate the transitions of all logs in the workspace, or of `only` these.

    `merge`: the logs are parts of one recording.

    Nothing is curated if none of these logs is usable.
    """
    from maglev_offline.ingest.store import ingest_logs

    result = ingest_logs(logs, workspace, recipe.request, jobs=jobs, merge=merge, progress=progress)
    if not result.folders:
        return Ingested(list(result.logs), None)
    _tell_shared(recipe, workspace, progress)
    curated = curate(recipe, workspace, progress, folders=result.folders if only else None)
    return Ingested(list(result.logs), curated)


def _tell_shared(recipe: Recipe, workspace: Workspace, progress: Progress) -> None:
    from maglev_offline.ingest.shared_content import find_shared_content
    from maglev_offline.ingest.store import samples_made_with

    folders, _ = samples_made_with(workspace, recipe.request)
    shared = find_shared_content(workspace, {folder: workspace.manifest(folder) for folder in folders})
    for finding in shared[:_MOST_SHARED]:
        progress.warn(f"{finding.log}, point {finding.point}: {finding.what} {finding.todo}")
    if len(shared) > _MOST_SHARED:
        progress.warn(f"{len(shared) - _MOST_SHARED:,} more such findings are in {workspace.path('shared_content')}.")


_MOST_SHARED = 8
"""So many findings of shared content are told; the artefact has all."""


def would_ingest(
    recipe: Recipe, logs: Sequence[Where], jobs: int, progress: Progress, *, merge: bool = False
) -> Ingested:
    """Say what would come of logs, and write nothing."""
    from maglev_offline.ingest.store import dry_run

    return Ingested(list(dry_run(logs, recipe.request, jobs=jobs, merge=merge, progress=progress).logs), None)


def curate(recipe: Recipe, workspace: Workspace, progress: Progress, *, folders: Sequence[Path] | None = None) -> Done:
    """Curate transitions from `folders`, or from those samples in the workspace that this recipe made.

    Raises
    ------
    ArtefactError: there are no samples, or only such as another recipe made.
    """
    from maglev_offline.curate.recovery.words import recovery_words
    from maglev_offline.curate.stage import curate as run_curate
    from maglev_offline.curate.words import balance_words, residual_lines, verdict_words

    if folders is None:
        folders = _fitting_samples(recipe, workspace, progress)
    folder, fresh = run_curate(
        workspace,
        recipe.curate,
        recipe.plant,
        recipe.mdp,
        pid=recipe.control.pid,
        cascade=recipe.control.cascade,
        folders=folders,
        progress=progress,
    )
    manifest = Manifest.read(folder)
    judged = {name: manifest.facts[name] for name in ("construction", "diagnostic", "recovery", "residual")}
    return Done(
        "curate",
        folder,
        fresh,
        f"{manifest.counts['transitions']:,} transitions of {manifest.counts['candidates']:,} usable ones, from "
        f"{len(manifest.inputs)} log{'s' * (len(manifest.inputs) != 1)} in the workspace; "
        f"{balance_words(manifest.facts)}; {verdict_words(manifest.facts)}; "
        f"{recovery_words(manifest.facts['recovery'])}",
        {
            "counts": manifest.counts,
            "left_out": manifest.left_out,
            "coverage": {name: fact for name, fact in manifest.facts.items() if name not in judged},
            **judged,
        },
        notes=residual_lines(manifest.facts),
    )


def _fitting_samples(recipe: Recipe, workspace: Workspace, progress: Progress) -> list[Path]:
    """The samples that this recipe made; others do not go with them, and are named."""
    from maglev_offline.ingest.store import samples_made_with

    folders, others = samples_made_with(workspace, recipe.request)
    if others:
        named = ", ".join([*(folder.name for folder in others[:3]), *["..."] * (len(others) > 3)])
        text = (
            f"samples of {len(others)} of {len(folders) + len(others)} logs were made with other [signals], [ingest] "
            f"or [plant] than this recipe has ({named})"
        )
        todo = "Ingest those logs again with this recipe."
        if not folders:
            raise ArtefactError(f"{text}.", where=str(workspace.path("samples")), todo=todo)
        progress.warn(f"{text} and are left out. {todo}")
    return folders


def prefill(recipe: Recipe, workspace: Workspace, algorithm: Algorithm, capacity: int | None = None) -> Done:
    """Make the prefill of one algorithm; `capacity`: slots of the buffer that it must fit into."""
    from maglev_offline.curate.words import verdict_words
    from maglev_offline.replay.prefill import make_prefill

    folder, fresh = make_prefill(workspace, algorithm, recipe.prefill, recipe.plant, recipe.mdp, capacity=capacity)
    manifest, curated = Manifest.read(folder), Manifest.read(workspace.path("transitions")).facts
    return Done(
        "prefill",
        folder,
        fresh,
        f"{manifest.counts['rows']:,} rows for {algorithm}, actions up to {manifest.facts['largest_action']:.2f} "
        f"of the voltage limit, mean cost {manifest.facts['mean_cost']:.3g}; {verdict_words(curated)}",
        {
            "algorithm": algorithm,
            "rows": manifest.counts["rows"],
            "left_out": manifest.left_out,
            "construction": curated.get("construction"),
            "diagnostic": curated.get("diagnostic"),
        },
    )


def export_prefill(recipe: Recipe, workspace: Workspace, algorithm: Algorithm, form: ExportForm) -> Done:
    """Write the prefill of one algorithm as another library reads it."""
    from maglev_offline.replay.exports.stage import FORMS, make_export

    folder, fresh = make_export(workspace, algorithm, form, recipe.plant, recipe.mdp)
    facts, rows = Manifest.read(folder).facts, Manifest.read(folder).counts["rows"]
    how = FORMS[form].how.format(path=folder)
    return Done(
        "export",
        folder,
        fresh,
        f"{rows:,} rows of {algorithm} for {facts['written_for']}, gamma {facts['gamma']:g}; load them with\n"
        f"     {how}",
        {"algorithm": algorithm, "rows": rows, "how": how, **facts},
    )


def control(recipe: Recipe, workspace: Workspace, progress: Progress) -> Done:
    """Try the classical controllers."""
    import numpy as np
    import pandas as pd

    from maglev_offline.control.stage import run_control

    folder, fresh = run_control(
        workspace, plant=recipe.plant, mdp=recipe.mdp, settings=recipe.control, progress=progress
    )
    manifest = Manifest.read(folder)
    table = pd.read_parquet(folder / "metrics.parquet")
    start = recipe.control.reference_start_gap_m
    table = table[np.isclose(table["start_gap_m"], start)]
    rows = [
        [
            f"{row['controller']}, {row['plant_kind']}",
            _seconds(row["settling_time_s"]),
            f"{row['overshoot']:.1%}",
            f"{row['steady_state_bias_m'] * 1e3:+.3f}",
            f"{row['peak_voltage_v']:.0f}",
            f"{row['cost']:.1f}",
        ]
        for row in table.to_dict("records")
    ]
    poles = ", ".join(f"{real:+.3f}{imag:+.3f}j" for real, imag in manifest.facts["poles_rad_s"])
    return Done(
        "control",
        folder,
        fresh,
        f"open-loop poles {poles} rad/s; u_eq {manifest.facts['equilibrium']['voltage_v']:.2f} V; "
        f"{_pid_words(manifest.facts, recipe)}",
        {"facts": manifest.facts},
        f"Regulation from {start * 1e3:g} mm to {recipe.plant.set_point_m * 1e3:g} mm",
        ("controller", "settles (s)", "overshoot", "bias (mm)", "peak (V)", "cost"),
        rows,
    )


def _pid_words(facts: dict[str, Any], recipe: Recipe) -> str:
    """The linear model, and how far the PID is from the edge of stability."""
    a, b = facts["a"], facts["b"]
    model = f"A = [{', '.join(str([round(x, 4) for x in row]) for row in a)}], B = {[round(row[0], 4) for row in b]}"
    ranges = [f"{found['lowest']:.0f} to {found['highest']:.0f} ({found['sampling']})" for found in facts["kp_ranges"]]
    margins = facts["margins"]["pid"]
    edge = (
        f"phase margin {margins['phase_margin_deg']:.2f} degrees, delay margin {margins['delay_margin_s'] * 1e3:.2f} ms"
        if margins["stable"] and margins["delay_margin_s"] is not None
        else "no margins: it is unstable as given"
    )
    return f"{model}; PID with Kp = {recipe.control.pid.kp:g}: stable for Kp {', '.join(ranges) or 'none'}, {edge}"


def _seconds(value: float) -> str:
    return "never" if math.isnan(value) else f"{value:.3f}"


def control_page(recipe: Recipe, workspace: Workspace) -> Path:
    """Write the page of the plant and its classical controllers."""
    from maglev_offline.report.stage import build_control_page

    return build_control_page(workspace, recipe.plain())


def identify(recipe: Recipe, workspace: Workspace, progress: Progress) -> Done:
    """Fit the plant's parameters to those samples in the workspace that this recipe made."""
    from maglev_offline.identify.stage import COLUMNS, run_identify, summary

    folders = _fitting_samples(recipe, workspace, progress)
    folder, fresh = run_identify(workspace, folders, recipe.plant, recipe.identify, progress)
    sentence, rows, facts = summary(folder)
    return Done("identify", folder, fresh, sentence, {"facts": facts}, "Parameters of the plant", COLUMNS, rows)


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

    if arm not in get_args(ArmName):
        raise InputError(f"there is no arm {arm!r}.", where="--arm", todo="Give empty or prefill.")
    if tensorboard:
        require_tensorboard()
    arms = arms_of(workspace, recipe.world, algorithms(recipe, asked), (cast(ArmName, arm),), recipe.prefill)
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


def transfer(recipe: Recipe, workspace: Workspace, jobs: int, progress: Progress) -> Done:
    """Compare the arms, training those that are missing."""
    from maglev_offline.transfer.stage import run_transfer
    from maglev_offline.transfer.verdict import enough_seeds

    algorithms(recipe, None)
    folder, fresh = run_transfer(
        workspace, recipe.world, recipe.transfer, recipe.prefill, recipe.control, jobs=jobs, progress=progress
    )
    manifest = Manifest.read(folder)
    if not enough_seeds(recipe.training.seeds, recipe.transfer.confidence):
        progress.warn(
            f"{recipe.training.seeds} seeds are too few for an interval at {recipe.transfer.confidence:.0%}: "
            "every verdict is inconclusive."
        )
    rows, words, primary = [], [], manifest.facts["primary_metric"]
    for algorithm, found in manifest.facts["algorithms"].items():
        for arm, effects in found["effects"].items():
            for metric, effect in effects.items():
                rows.append(_effect_row(algorithm, arm, metric, effect))
            words.append(f"{algorithm} {effects[primary]['verdict']}")
    return Done(
        "transfer",
        folder,
        fresh,
        f"prefill against an empty buffer, judged by {primary.replace('_', ' ')}: {', '.join(words)}",
        {"verdict": manifest.facts},
        "Empty minus prefill (costs; a positive difference means that prefill helps)",
        ("metric", "empty", "prefill", "difference", f"{recipe.transfer.confidence:.0%} interval", "verdict"),
        rows,
    )


def _effect_row(algorithm: str, arm: str, metric: str, effect: dict[str, Any]) -> list[str]:
    low, high = effect["low"], effect["high"]
    return [
        f"{algorithm}: {metric.replace('_', ' ')}",
        f"{effect['baseline_mean']:.4g}",
        f"{effect['arm_mean']:.4g}",
        f"{effect['difference']:+.4g}",
        "-" if low is None else f"{low:+.4g} to {high:+.4g}",
        effect["verdict"] if arm == "prefill" else f"{arm}: {effect['verdict']}",
    ]


def report(recipe: Recipe, workspace: Workspace, progress: Progress) -> Done:
    """Write the page."""
    from maglev_offline.report.stage import build_report

    page, fresh = build_report(workspace, recipe.report, recipe.plain(), recipe.name, progress=progress)
    return Done("report", page, fresh, f"{page.stat().st_size / 1e6:.2f} MB, one file, opens without a network")


def run(recipe: Recipe, workspace: Workspace, logs: Sequence[Where], jobs: int, progress: Progress) -> Run:
    """Go the whole road. A recipe without algorithms ends at the classical controllers, and reports that.

    Where no log can be used there is nothing to go on with, and the road ends at once.
    """
    ingested = ingest(recipe, workspace, logs, jobs, progress, only=True)
    if ingested.transitions is None:
        return Run(ingested, [])
    stages = [ingested.transitions]

    def done(one: Done) -> None:
        stages.append(one)
        progress.say("\n".join(one.lines()))

    progress.say("\n".join(ingested.lines()))
    done(control(recipe, workspace, progress))
    if recipe.training.algorithms:
        for algorithm in recipe.training.algorithms:
            done(prefill(recipe, workspace, algorithm))
        done(transfer(recipe, workspace, jobs, progress))
    done(report(recipe, workspace, progress))
    return Run(ingested, stages)
