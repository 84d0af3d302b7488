"""The stage that finds what logs share: the same values under another name, or a part of one log in another."""

from collections.abc import Mapping
from pathlib import Path

from maglev_offline.ingest.content import CONTENT, ContentSketch, load_content
from maglev_offline.ingest.content_findings import content_findings
from maglev_offline.ingest.content_overlaps import overlaps
from maglev_offline.ingest.findings import FINDINGS, Finding, by_severity, load_findings, save_findings
from maglev_offline.workspace import Manifest, Workspace, fingerprint

KIND = "shared_content"
"""The artefact, and its folder in the workspace."""


def find_shared_content(workspace: Workspace, folders: Mapping[Path, Manifest]) -> list[Finding]:
    """Hold the samples in `folders` against each other; what was found is an artefact of its own.

    A log's own artefact does not tell of it, since it must not depend on which other logs there are.
    """
    inputs = {folder.name: manifest.files[CONTENT] for folder, manifest in folders.items()}
    mark = fingerprint(KIND, inputs)
    folder = workspace.path(KIND)
    if workspace.is_current(folder, mark):
        return load_findings(folder / FINDINGS)
    sketches: dict[tuple[str, str], ContentSketch] = {}
    for one in folders:
        sketches |= {(one.name, point): sketch for point, sketch in load_content(one / CONTENT).items()}
    found = by_severity(content_findings(overlaps(sketches)))
    manifest = Manifest(artefact=KIND, fingerprint=mark, inputs=inputs, counts={"findings": len(found)})
    with workspace.commit(folder, manifest) as draft:
        save_findings(found, draft / FINDINGS)
    return found
