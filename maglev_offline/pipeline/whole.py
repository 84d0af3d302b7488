"""The whole road: `run`, and the pages at its end: the report, and the card of the dataset."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from maglev_offline.errors import InputError
from maglev_offline.filesystems import Where, write_whole
from maglev_offline.outcomes import Done, Run
from maglev_offline.pipeline.data import ingest, prefill
from maglev_offline.pipeline.learning import transfer
from maglev_offline.pipeline.plant import control
from maglev_offline.progress import Progress
from maglev_offline.recipe import Recipe
from maglev_offline.workspace import Manifest, Workspace


def report(recipe: Recipe, workspace: Workspace, progress: Progress) -> Done:
    """Write the page."""
    from maglev_offline.report.stage import build_report

    page, fresh = build_report(workspace, recipe.report, recipe.plain(), recipe.name, progress=progress)
    return Done("report", page, fresh, f"{page.stat().st_size / 1e6:.2f} MB, one file, opens without a network")


def card(recipe: Recipe, workspace: Workspace, progress: Progress, out: Path | None = None) -> Done:
    """Write the dataset card of the transitions, and copies of its files into the folder `out`.

    Raises
    ------
    InputError: `out` is a file.
    """
    from maglev_offline.report.card.stage import JSON, PAGE, build_card
    from maglev_offline.report.evidence import without_none

    if out is not None and out.exists() and not out.is_dir():
        raise InputError("this is a file, and the card is two.", where=str(out), todo="Give a folder to --out.")
    folder, fresh = build_card(workspace, recipe.name, recipe.description)
    manifest, made = Manifest.read(folder), Manifest.read(workspace.path("transitions"))
    given = recipe.plain()
    other = [f"[{name}]" for name, table in without_none(made.settings).items() if given.get(name, table) != table]
    if other:
        progress.warn(f"card: the transitions were made with other tables than the recipe has ({', '.join(other)}).")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        for name in (JSON, PAGE):
            write_whole(out / name, (folder / name).read_bytes())
    return Done(
        "card",
        folder,
        fresh,
        f"{manifest.counts['logs']} logs, {manifest.counts['candidates']:,} usable rows, verdict "
        f"{manifest.facts['verdict']}; {PAGE} opens without a network, {JSON} is for machines",
        {"files": [str((out or folder) / name) for name in (JSON, PAGE)], **manifest.facts, **manifest.counts},
        notes=[] if out is None else [f"copied to {out}"],
    )


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
