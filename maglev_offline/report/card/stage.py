"""The stage: the transitions of a workspace -> their card, for machines and for people."""

import json
from pathlib import Path

from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.report.card.facts import card_facts, rules_of, splits_of
from maglev_offline.report.card.page import card_page
from maglev_offline.report.card.parts import parts_of
from maglev_offline.report.card.sample import packed, read_candidates, sample_of
from maglev_offline.report.evidence import CARD
from maglev_offline.workspace import Manifest, Workspace, fingerprint

JSON, PAGE = "card.json", "card.html"
LAYOUT = 2
"""Counts up where the files of the artefact become others, so that an older one is made anew."""


def build_card(workspace: Workspace, name: str, description: str = "") -> tuple[Path, bool]:
    """Commit the artefact `card` with `card.json` and `card.html`; return its folder and whether it is new.

    `name`, `description`: those of the recipe. All else is what the artefacts say.

    Raises
    ------
    ArtefactError: there are no transitions, or the samples they were made of have changed.
    """
    parts = parts_of(workspace)
    home = workspace.path(CARD)
    mark = fingerprint(
        CARD,
        parts.hashes,
        name=name,
        description=description,
        shared=None if parts.shared is None else [one.plain() for one in parts.shared],
        layout=LAYOUT,
    )
    if workspace.is_current(home, mark):
        return home, False
    folder, settings = parts.transitions.folder, parts.transitions.manifest.settings
    candidates = read_candidates(folder)
    plant, mdp = Plant.model_validate(settings["plant"]), Mdp.model_validate(settings["mdp"])
    sample = sample_of(candidates, folder, plant, mdp, settings["curate"]["seed"])
    split = splits_of(candidates, folder)
    card = card_facts(parts, name, description, split)
    scatter = packed(sample, candidates, rules_of(settings))
    manifest = Manifest(CARD, mark, parts.hashes)
    manifest.counts = {"logs": len(parts.samples), "candidates": len(candidates), "sample": len(sample)}
    manifest.facts = {"verdict": card["intended_use"]["verdict"], "simulated": card["intended_use"]["simulated"]}
    with workspace.commit(home, manifest) as draft:
        text = json.dumps(card, indent=1, ensure_ascii=False, allow_nan=False)
        (draft / JSON).write_text(text + "\n", encoding="utf-8", errors="backslashreplace")
        (draft / PAGE).write_text(card_page(card, scatter), encoding="utf-8", errors="backslashreplace")
    return home, True
