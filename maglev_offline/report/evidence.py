"""All artefacts of a workspace as the report reads them; what is not there is None, never made up."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pydantic import ValidationError

from maglev_offline.ingest.samples import QUARANTINE, SAMPLES, load_samples
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.prefill import load_prefill
from maglev_offline.report.versions import as_told, made_by_another
from maglev_offline.workspace import Manifest, Workspace, input_hash

REPORT = "report"
CARD = "card"
PAGES = (REPORT, "control_page", CARD)
"""The pages are artefacts too, but no evidence."""


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
    """The artefacts by name, in order; `periods`: those of the workspaces within, by the names of their folders."""

    artefacts: Mapping[str, Artefact]
    periods: Mapping[str, "Evidence"] = field(default_factory=dict)

    def get(self, name: str) -> Artefact | None:
        """The artefact of that name, if it was made."""
        return self.artefacts.get(name)

    def under(self, kind: str) -> list[Artefact]:
        """All artefacts of a kind, such as `samples`, in order of their names."""
        return [a for name, a in self.artefacts.items() if name.startswith(f"{kind}/")]

    @property
    def hashes(self) -> dict[str, str]:
        """The hash of every artefact, by name; those of the workspaces within below `periods/`."""
        own = {name: a.hash for name, a in self.artefacts.items()}
        inner = {
            f"{WITHIN}/{period}/{name}": hash_
            for period, evidence in self.periods.items()
            for name, hash_ in evidence.hashes.items()
        }
        return own | inner

    @property
    def anchors(self) -> dict[str, str]:
        """Where on the page the row of each artefact is, by its name, which may hold what no anchor can."""
        return {name: f"artefact-{place}" for place, name in enumerate(self.artefacts, start=1)}

    @property
    def blocks(self) -> list[Artefact]:
        """The blocks of seeds that the study holds: those of the transfer artefact, where there is one.

        Without one, those of each arm that were trained like its last block; a seed that came twice counts once.
        """
        study, trained = self.get("transfer"), self.under("training")
        if study is not None:
            return [a for a in trained if a.name in study.manifest.inputs]
        chosen: list[Artefact] = []
        for arm in dict.fromkeys(a.folder.parent.name for a in trained):
            blocks = [a for a in trained if a.folder.parent.name == arm]
            alike = [a for a in blocks if _training_of(a) == _training_of(blocks[-1])]
            seen: set[int] = set()
            for block in sorted(alike, key=lambda a: -len(a.facts["seeds"])):
                if not seen & set(block.facts["seeds"]):
                    seen |= set(block.facts["seeds"])
                    chosen.append(block)
        return chosen

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
        start = control.manifest.settings["control"]["reference_start_gap_m"]
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
            try:
                return Plant.model_validate(settings["plant"]), Mdp.model_validate(settings["mdp"])
            except ValidationError as error:
                wrong = ".".join(str(part) for part in error.errors()[0]["loc"])
                raise made_by_another(artefact.name, artefact.folder, f"no {wrong!r} that can be read") from None
        return None

    def foreign(self, recipe: Mapping[str, Any]) -> list[str]:
        """Names of artefacts that another recipe made: `name ([table], ...)`."""
        found = []
        for name, artefact in self.artefacts.items():
            if name.startswith(("arms/", "curated/")):  # an arm's tables differ on purpose, and it says so itself
                continue
            both = (artefact.manifest.settings, recipe)
            made, wanted = (_without_training(without_none(tables), _MEANS) for tables in both)
            if name.startswith("training/"):
                arm = artefact.folder.parent.name.partition("-")[2]
                made, wanted = _without_seeds(made), _without_seeds(_of_arm(wanted, arm))
            other = [f"[{table}]" for table, value in made.items() if table in wanted and value != wanted[table]]
            if other:
                found.append(f"{name} ({', '.join(other)})")
        return found + self._foreign_periods(recipe)

    def _foreign_periods(self, recipe: Mapping[str, Any]) -> list[str]:
        """Studies at other periods with another number of seeds than the recipe asks for, or that it does not name."""
        asked = recipe.get("transfer", {})
        seeds = recipe.get("training", {}).get("seeds")
        wanted = min(filter(None, [asked.get("other_periods_seeds"), seeds]), default=None)
        found = []
        for period, evidence in self.periods.items():
            study = evidence.get("transfer")
            named = float(period.removesuffix("ms")) in asked.get("control_periods_ms", [])
            if study is not None and (not named or study.manifest.settings["training"]["seeds"] != wanted):
                found.append(f"{WITHIN}/{period}/transfer ({'[training] seeds' if named else 'no period of it'})")
        return found

    def stale(self) -> list[str]:
        """Names of artefacts that were made from others which have changed since."""
        return [
            name
            for name, a in self.artefacts.items()
            if any(self.hashes.get(source, known) != known for source, known in a.manifest.inputs.items())
        ]


def _training_of(block: Artefact) -> Any:
    """What a block was trained with, but for which seeds it holds."""
    return _without_seeds(block.manifest.settings)


def _of_arm(recipe: Mapping[str, Any], arm: str) -> dict[str, Any]:
    """The recipe with what it says differs in training in that arm."""
    arms = recipe.get("transfer", {}).get("arm", {})
    own = arms.get(arm, arms.get(arm.partition("-without-")[0], {})).get("training", {})
    return {**recipe, "training": {**recipe.get("training", {}), **own}} if own else dict(recipe)


def _without_seeds(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of a recipe without what does not touch a single block: how many seeds and algorithms there are."""
    return _without_training(tables, ("seeds", "first_seed", "algorithms", *_MEANS))


_MEANS = ("engine", "checkpoint_every")
"""By what means training is asked for; the engine that was taken is a fact of the block."""


def _without_training(tables: Mapping[str, Any], keys: tuple[str, ...]) -> dict[str, Any]:
    if "training" not in tables:
        return dict(tables)
    return {**tables, "training": {key: value for key, value in tables["training"].items() if key not in keys}}


def without_none(value: Any) -> Any:
    """A table without the keys that are not given, as recipes are written."""
    if isinstance(value, Mapping):
        return {key: without_none(part) for key, part in value.items() if part is not None}
    return [without_none(part) for part in value] if isinstance(value, list) else value


WITHIN = "periods"
"""Folder of workspaces of their own (see transfer/periods.py), whose artefacts are not this one's."""


PERIOD = re.compile(r"\d+(\.\d+)?(e[+-]?\d+)?ms")


def gather(workspace: Workspace) -> Evidence:
    """Read the manifests of all artefacts in the workspace, and in those that it holds for other control periods.

    Raises
    ------
    ArtefactError: a manifest is damaged, or another version made an artefact that lacks what pages show.
    """
    # Numbers of milliseconds in order of size, from the longest; other folders are none of ours.
    homes = [path for path in workspace.path(WITHIN).glob("*") if path.is_dir() and PERIOD.fullmatch(path.name)]
    homes.sort(key=lambda path: -float(path.name.removesuffix("ms")))
    return Evidence(_artefacts(workspace.root), {path.name: Evidence(_artefacts(path)) for path in homes})


def _artefacts(root: Path) -> dict[str, Artefact]:
    found = {}
    for path in sorted(root.rglob("manifest.json")):
        parts = path.parent.relative_to(root).parts
        if not parts or parts[0] in (*PAGES, WITHIN) or any(part.startswith(".") for part in parts):
            continue
        name = "/".join(parts)
        mark = input_hash(path.parent)
        found[name] = Artefact(name, path.parent, as_told(Manifest.read(path.parent), name, path.parent), mark)
    return dict(sorted(found.items()))


def samples_of_a_point(log: Artefact) -> pd.DataFrame:
    """The samples of the first point of a log, however many the others have."""
    first = next(pq.ParquetFile(log.folder / SAMPLES).iter_batches(batch_size=1, columns=["point"]))
    return load_samples([log.folder], str(first["point"][0]))


def quarantine_of(log: Artefact) -> pd.DataFrame:
    """The quarantine ledger of one log."""
    return pd.read_parquet(log.folder / QUARANTINE)


def _joined(paths: Iterable[Path]) -> pd.DataFrame | None:
    tables = [pd.read_parquet(path) for path in paths]
    return pd.concat(tables, ignore_index=True) if tables else None
