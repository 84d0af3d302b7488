"""The artefacts that a card is about: the transitions, and those before and after them that belong to them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maglev_offline.errors import ArtefactError
from maglev_offline.ingest.content import CONTENT
from maglev_offline.ingest.findings import FINDINGS, Finding, load_findings
from maglev_offline.ingest.shared_content import KIND as SHARED
from maglev_offline.report.evidence import Artefact
from maglev_offline.report.versions import as_told
from maglev_offline.workspace import Workspace

TRANSITIONS = "transitions"


@dataclass(frozen=True)
class Parts:
    """The transitions, the samples that they were made of, and the prefills that were made of them.

    `shared`: what the logs have in common, None where they have not been held against each other.
    """

    transitions: Artefact
    samples: tuple[Artefact, ...]
    prefills: tuple[Artefact, ...]
    shared: tuple[Finding, ...] | None

    @property
    def hashes(self) -> dict[str, str]:
        """The hash of every artefact, by name."""
        return {a.name: a.hash for a in (*self.samples, self.transitions, *self.prefills)}

    @property
    def facts(self) -> Mapping[str, Any]:
        """The findings of the stage `curate`."""
        return self.transitions.facts


def parts_of(workspace: Workspace) -> Parts:
    """Gather them; prefills of older transitions are no part of the card.

    Raises
    ------
    ArtefactError: there are no transitions, or not all samples that they were made of are there as they were.
    """
    if not (workspace.path(TRANSITIONS) / "manifest.json").is_file():
        todo = "Run `maglev-offline ingest LOGS...` first, or give the right --workspace."
        raise ArtefactError("there are no transitions in the workspace.", where=str(workspace.root), todo=todo)
    transitions = _artefact(workspace, workspace.path(TRANSITIONS))
    wanted = transitions.manifest.inputs
    there = [name for name in wanted if (workspace.root / name / "manifest.json").is_file()]
    samples = tuple(_artefact(workspace, workspace.root / name) for name in there)
    same = {a.name for a in samples if a.hash == wanted[a.name]}
    other = sorted(set(wanted) - same)
    if other:
        named = ", ".join(other[:3]) + (", ..." if other[3:] else "")
        raise ArtefactError(
            f"the transitions were made from samples that have changed or are gone since ({named}).",
            where=str(workspace.root),
            todo="Run `maglev-offline curate` again.",
        )
    made = [_artefact(workspace, folder) for folder in workspace.list("prefill")]
    prefills = tuple(a for a in made if a.manifest.inputs.get(TRANSITIONS) == transitions.hash)
    return Parts(transitions, samples, prefills, _shared(workspace, samples))


def _artefact(workspace: Workspace, folder: Path) -> Artefact:
    name = folder.relative_to(workspace.root).as_posix()
    mark = workspace.input_hash(folder)
    return Artefact(name, folder, as_told(workspace.manifest(folder), name, folder), mark)


def _shared(workspace: Workspace, samples: tuple[Artefact, ...]) -> tuple[Finding, ...] | None:
    """Findings on what these logs share, if just these contents (maybe with others) were held against each other."""
    folder = workspace.path(SHARED)
    if not (folder / "manifest.json").is_file():
        return None
    compared = workspace.manifest(folder).inputs
    if any(compared.get(a.folder.name) != a.manifest.files.get(CONTENT) for a in samples):
        return None
    logs = {a.folder.name for a in samples}
    return tuple(finding for finding in load_findings(folder / FINDINGS) if finding.log in logs)
