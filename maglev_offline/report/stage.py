"""The stage: everything in the workspace -> one self-contained page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from maglev_offline import __version__
from maglev_offline.errors import ArtefactError
from maglev_offline.progress import SILENT, Progress
from maglev_offline.report import words
from maglev_offline.report.evidence import REPORT, Evidence, gather
from maglev_offline.report.page import Live, Paragraph, Plot, Section, Table, not_yet
from maglev_offline.report.sections_data import (
    coverage_section,
    origin_section,
    prefill_section,
    trajectories_section,
)
from maglev_offline.report.sections_learning import (
    TRANSFER,
    curves_section,
    regulation_section,
    settling_of,
)
from maglev_offline.report.sections_plant import plant_section
from maglev_offline.report.sections_recipe import recipe_section
from maglev_offline.report.sections_truth import truth_section
from maglev_offline.report.sections_verdict import verdict_section
from maglev_offline.report.settings import ReportSettings
from maglev_offline.report.study.abstract import abstract
from maglev_offline.report.study.arms import judged_arms
from maglev_offline.report.study.paper import paper_section
from maglev_offline.report.study.periods import periods_section
from maglev_offline.report.study.runs import runs_section
from maglev_offline.report.study.sections import differences_section, profiles_section, why_section
from maglev_offline.report.study.threats import threats_section
from maglev_offline.report.svg import inline_svg
from maglev_offline.report.typesetting import json_block, page_environment, script_mark, source
from maglev_offline.workspace import Manifest, Workspace, fingerprint

PAGE = "report.html"
CONTROL_PAGE = "control_page"


def build_report(
    workspace: Workspace,
    settings: ReportSettings,
    recipe: Mapping[str, Any],
    recipe_name: str,
    *,
    progress: Progress = SILENT,
) -> tuple[Path, bool]:
    """Commit the artefact `report`, one page of all that is in the workspace; return its path and whether it is new.

    `recipe`: the resolved recipe as plain tables, shown as it is. A part whose artefact has not been made yet says so.

    Raises
    ------
    ArtefactError: the manifest of an artefact is damaged.
    """
    evidence = gather(workspace)
    if not evidence.artefacts:
        raise ArtefactError(
            "there is nothing in the workspace to report on.",
            where=str(workspace.root),
            todo="Run `maglev-offline ingest LOGS...` first, or give the right --workspace.",
        )
    home = workspace.path(REPORT)
    mark = fingerprint("report", evidence.hashes, settings, recipe=dict(recipe), recipe_name=recipe_name)
    if workspace.is_current(home, mark):
        return home / PAGE, False
    for name in evidence.stale():
        progress.warn(f"report: {name} was made from artefacts that have changed since; run its stage again.")
    head = head_section(evidence, recipe)
    sections = body_sections(evidence, settings, recipe, recipe_name, mark)
    manifest = Manifest(REPORT, mark, evidence.hashes)
    manifest.settings = {"report": settings.model_dump(mode="json")}
    manifest.counts = {
        "sections": len(sections),
        "figures": sum(isinstance(block, Plot | Live) for section in sections for block in section.blocks),
        "tables": sum(isinstance(block, Table) for section in sections for block in section.blocks),
    }
    with workspace.commit(home, manifest) as draft:
        (draft / PAGE).write_text(render(settings.title, head, sections, evidence), encoding="utf-8")
    return home / PAGE, True


def build_control_page(workspace: Workspace, recipe: Mapping[str, Any]) -> Path:
    """Commit `control_page/control.html`, the plant and its classical controllers alone; return its path.

    Raises
    ------
    ArtefactError: the `control` artefact has not been made.
    """
    everything = gather(workspace)
    control = everything.get("control")
    if control is None:
        raise ArtefactError(
            "the classical controllers have not been tried.", where=str(workspace.root), todo="Run `control` first."
        )
    evidence = Evidence({"control": control})
    home = workspace.path(CONTROL_PAGE)
    mark = fingerprint(CONTROL_PAGE, evidence.hashes, recipe=dict(recipe))
    page = home / "control.html"
    if not workspace.is_current(home, mark):
        sections = [plant_section(evidence), regulation_section(evidence, trains=False)]
        title = f"The plant and its classical controllers: {recipe.get('name', 'defaults')}"
        with workspace.commit(home, Manifest(CONTROL_PAGE, mark, evidence.hashes)) as draft:
            (draft / page.name).write_text(render(title, Section("head", ""), sections, evidence), encoding="utf-8")
    return page


def recipe_trains(recipe: Mapping[str, Any]) -> bool:
    """Whether the recipe has an agent to train; one that does not say so has."""
    return bool(recipe.get("training", {}).get("algorithms", True))


def head_section(evidence: Evidence, recipe: Mapping[str, Any]) -> Section:
    """The answer, where the data came from, whether the agents learned at all, and what to doubt."""
    head, trains = Section("head", ""), recipe_trains(recipe)
    study, logs = evidence.get("transfer"), evidence.under("samples")
    if study is not None:
        rows = {a.folder.name: a.manifest.counts["rows"] for a in evidence.under("prefill")}
        confidence = float(study.manifest.settings["transfer"]["confidence"])
        lead, *more = abstract(study.facts, confidence)
        head.blocks += [Paragraph(lead, "lead"), *(Paragraph(text, "abstract") for text in more)]
        told = judged_arms(study.facts)
        head.blocks += [Paragraph(text) for text in words.answers(study.facts, rows, confidence, told)]
        comparison = words.classical_sentence(settling_of(evidence))
        learned = words.learned_sentence(study.facts, ["empty", *told])
        head.blocks.append(Paragraph(f"{words.DIRECTION} {learned} {comparison}".strip()))
    elif not trains:
        text = "The recipe trains no agent: this page shows the logged data and the classical controllers."
        head.blocks.append(Paragraph(text))
    else:
        head.blocks.append(not_yet("There is no verdict yet: the arms have not been compared.", TRANSFER))
    simulated = words.simulated_sentence(sum(bool(log.facts.get("simulated")) for log in logs), len(logs))
    if simulated:
        head.blocks.append(Paragraph(simulated, "note"))
    transitions = evidence.get("transitions")
    doubts = [] if transitions is None else transitions.facts.get("doubts", [])
    head.blocks += [Paragraph(f"To be doubted: {doubt}", "warning") for doubt in doubts]
    foreign = evidence.foreign(recipe)
    if foreign:
        text = "Made with other tables than those of the recipe that this page shows (by another recipe, or by options "
        text += f"such as --seeds and --steps): {', '.join(foreign)}."
        head.blocks.append(Paragraph(text, "warning"))
    stale = evidence.stale()
    if stale:
        text = f"Older than what they were made from, and to be made again: {', '.join(stale)}."
        head.blocks.append(Paragraph(text, "warning"))
    return head


STUDY = (
    *(differences_section, profiles_section, why_section, periods_section),
    *(paper_section, threats_section, runs_section),
)
"""Sections that stand where the study has something to say for them."""


def body_sections(
    evidence: Evidence, settings: ReportSettings, recipe: Mapping[str, Any], recipe_name: str, mark: str
) -> list[Section]:
    """All sections below the head, in order."""
    trains = recipe_trains(recipe)
    return [
        origin_section(evidence),
        trajectories_section(evidence, settings),
        coverage_section(evidence),
        truth_section(evidence),
        prefill_section(evidence, trains=trains),
        plant_section(evidence),
        regulation_section(evidence, trains=trains),
        curves_section(evidence, trains=trains),
        verdict_section(evidence, trains=trains),
        *filter(None, (part(evidence) for part in STUDY)),
        recipe_section(evidence, recipe, recipe_name, mark, trains=trains),
    ]


def drawn(plot: Plot) -> Markup:
    """The figure as markup, to be set into the page."""
    return inline_svg(plot.figure(), plot.key)


def render(title: str, head: Section, sections: list[Section], evidence: Evidence) -> str:
    """Set the page. Every text is escaped; only the figures, which matplotlib has escaped, are markup.

    A page with a figure that can be questioned has one script, which its security policy names by its hash.
    """
    environment = page_environment()
    environment.globals["svg"] = drawn
    environment.globals["json"] = json_block
    environment.tests["block"] = lambda block, kind: type(block).__name__ == kind
    moves = any(isinstance(block, Live) for section in sections for block in section.blocks)
    script = source("curves.js") if moves else ""
    return environment.get_template("report.html.j2").render(
        title=title,
        head=head,
        sections=sections,
        version=__version__,
        script=Markup(script),
        script_mark=script_mark(script),
        anchors={name: (anchor, evidence.artefacts[name].hash[:16]) for name, anchor in evidence.anchors.items()},
    )
