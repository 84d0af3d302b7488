"""All artefacts of a workspace as the report reads them; what is not there is None, never made up."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.ingest.samples import QUARANTINE, load_samples
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.prefill import load_prefill
from maglev_offline.workspace import Manifest, Workspace, input_hash

REPORT = "report"
"""Name of the report's own artefact, which is no evidence."""


@dataclass(frozen=True)
class Artefact:
    """One artefact: its name in the workspace, its folder, its manifest and the hash that stands for it."""

    name: str
    folder: Path
    manifest: Manifest
    hash: str

    @property
    def facts(self) -> Mapping[str, Any]:
        """The stage's own findings."""
        return self.manifest.facts


@dataclass(frozen=True)
class Evidence:
    """The artefacts by name, in order."""

    artefacts: Mapping[str, Artefact]

    def get(self, name: str) -> Artefact | None:
        """The artefact of that name, if it was made."""
        return self.artefacts.get(name)

    def under(self, kind: str) -> list[Artefact]:
        """All artefacts of a kind, such as `samples`, in order of their names."""
        return [a for name, a in self.artefacts.items() if name.startswith(f"{kind}/")]

    @property
    def hashes(self) -> dict[str, str]:
        """The hash of every artefact, by name."""
        return {name: a.hash for name, a in self.artefacts.items()}

    @property
    def blocks(self) -> list[Artefact]:
        """The blocks of seeds that the study holds; those of the transfer artefact, where there is one."""
        study = self.get("transfer")
        return [a for a in self.under("training") if study is None or a.name in study.manifest.inputs]

    def curves(self) -> pd.DataFrame | None:
        """Evaluations of all runs: those that the verdict is about, or those trained so far."""
        study = self.get("transfer")
        if study is not None:
            return pd.read_parquet(study.folder / "curves.parquet")
        return _joined(a.folder / "curves.parquet" for a in self.blocks)

    def regulation(self) -> pd.DataFrame | None:
        """Responses of the last policies from the reference start."""
        return _joined(a.folder / "regulation.parquet" for a in self.blocks)

    def control_responses(self) -> pd.DataFrame | None:
        """Responses of the classical controllers on the nonlinear plant, from the reference start."""
        return self._control("responses.parquet")

    def control_metrics(self) -> pd.DataFrame | None:
        """Metrics of the classical controllers on the nonlinear plant, from the reference start."""
        return self._control("metrics.parquet")

    def _control(self, file: str) -> pd.DataFrame | None:
        control = self.get("control")
        if control is None:
            return None
        start = control.manifest.settings["reference_start_gap_m"]
        table = pd.read_parquet(control.folder / file, filters=[("plant_kind", "==", "nonlinear")])
        return table[np.isclose(table["start_gap_m"], start)].reset_index(drop=True)

    def transitions(self, which: str) -> pd.DataFrame | None:
        """The `transitions` (curated) or the `candidates`."""
        made = self.get("transitions")
        return None if made is None else pd.read_parquet(made.folder / f"{which}.parquet")

    def prefills(self) -> dict[str, Mapping[str, NDArray[np.generic]]]:
        """The columns of every prefill, by algorithm."""
        return {a.folder.name: load_prefill(a.folder) for a in self.under("prefill")}

    def process(self) -> tuple[Plant, Mdp] | None:
        """The plant and the decision process that the artefacts were made with, if any of them says so."""
        for artefact in (*self.blocks, *filter(None, [self.get("transitions")])):
            settings = artefact.manifest.settings
            return Plant.model_validate(settings["plant"]), Mdp.model_validate(settings["mdp"])
        return None

    def stale(self) -> list[str]:
        """Names of artefacts that were made from others which have changed since."""
        return [
            name
            for name, a in self.artefacts.items()
            if any(self.hashes.get(source, known) != known for source, known in a.manifest.inputs.items())
        ]


def gather(workspace: Workspace) -> Evidence:
    """Read the manifests of all artefacts in the workspace.

    Raises
    ------
    ArtefactError: a manifest is damaged.
    """
    found = {}
    for path in sorted(workspace.root.rglob("manifest.json")):
        parts = path.parent.relative_to(workspace.root).parts
        if not parts or parts[0] == REPORT or any(part.startswith(".") for part in parts):
            continue
        name = "/".join(parts)
        found[name] = Artefact(name, path.parent, Manifest.read(path.parent), input_hash(path.parent))
    return Evidence(dict(sorted(found.items())))


def samples_of(log: Artefact) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The samples and the quarantine ledger of one log."""
    return load_samples([log.folder]), pd.read_parquet(log.folder / QUARANTINE)


def _joined(paths: Iterable[Path]) -> pd.DataFrame | None:
    tables = [pd.read_parquet(path) for path in paths]
    return pd.concat(tables, ignore_index=True) if tables else None
