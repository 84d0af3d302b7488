"""Finds a policy in the training artefacts of a workspace: `training/<algorithm>-<arm>/seeds-*/<which>.safetensors`."""

from pathlib import Path
from typing import Literal

import numpy as np

from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.policies.policy import Origin, Policy, checked
from maglev_offline.settings import Settings
from maglev_offline.workspace import Manifest, Workspace, sha256_of

Which = Literal["last", "best"]

KIND = "training"
"""The kind of artefact, and its folder in the workspace."""


def trained_policy(
    workspace: Workspace, algorithm: str | None, arm: str | None, seed: int, which: Which, *recipe: Settings
) -> Policy:
    """The last or best actor of a seed. Algorithm and arm may be left open where only one of them was trained.

    `recipe`: tables of the current recipe; where the seed was trained with several recipes, the one of these counts.

    Raises
    ------
    ArtefactError: nothing was trained, or the artefact is damaged.
    InputError: several arms, or none, are meant; the seed is not in the arm, or is in it with several recipes.
    """
    title = _arm_title(workspace, algorithm, arm)
    folder = _block(workspace, title, seed, recipe)
    manifest = workspace.manifest(folder)
    origin = Origin(
        algorithm=title.partition("-")[0],
        arm=title.partition("-")[2],
        seed=seed,
        which=which,
        engine=str(manifest.facts.get("engine", "")),
        artefact=manifest.artefact,
        fingerprint=manifest.fingerprint,
        manifest_sha256=workspace.input_hash(folder),
        weights_sha256=sha256_of(folder / f"{which}.safetensors"),
    )
    return _read(folder / f"{which}.safetensors", manifest, origin)


def _read(path: Path, manifest: Manifest, origin: Origin) -> Policy:
    from safetensors import SafetensorError
    from safetensors.numpy import load_file

    try:
        place = manifest.facts["seeds"].index(origin.seed)
        net = {name: np.ascontiguousarray(value[place]) for name, value in load_file(path).items()}
        plant = Plant.model_validate(manifest.settings["plant"])
        mdp = Mdp.model_validate(manifest.settings["mdp"])
    except (OSError, SafetensorError, KeyError, IndexError, ValueError, TypeError, AttributeError) as error:
        raise ArtefactError(
            f"the actors of the training cannot be read ({type(error).__name__}).",
            where=str(path),
            todo="Remove that folder and train again.",
        ) from None
    return checked(Policy(net, plant, mdp, origin), str(path))


def _arm_title(workspace: Workspace, algorithm: str | None, arm: str | None) -> str:
    home = workspace.path(KIND)
    there = sorted(p.name for p in home.iterdir() if workspace.list(f"{KIND}/{p.name}")) if home.is_dir() else []
    if not there:
        raise ArtefactError(
            "no agent has been trained in this workspace.",
            where=str(workspace.root),
            todo="Run `maglev-offline train`.",
        )
    asked = [(algorithm.lower() if algorithm else None), arm]
    fitting = [
        title
        for title in there
        if all(want in (None, part) for want, part in zip(asked, title.split("-", 1), strict=True))
    ]
    if len(fitting) != 1:
        wanted = " and ".join(
            f"{option} {value}" for option, value in (("--algo", algorithm), ("--arm", arm)) if value is not None
        )
        what = f"several arms fit: {', '.join(fitting)}." if fitting else f"{wanted} was not trained."
        todo = "Give --algo and --arm." if fitting else f"There is {', '.join(there)}; others come from `train`."
        raise InputError(what, where=str(home), todo=todo)
    return fitting[0]


def _block(workspace: Workspace, title: str, seed: int, recipe: tuple[Settings, ...]) -> Path:
    """Folder of the block of seeds that has the seed."""
    blocks = {folder: workspace.manifest(folder) for folder in workspace.list(f"{KIND}/{title}")}
    found = [folder for folder, manifest in blocks.items() if seed in manifest.facts.get("seeds", ())]
    if not found:
        there = sorted({number for manifest in blocks.values() for number in manifest.facts.get("seeds", ())})
        raise InputError(
            f"seed {seed} of {title} was not trained.",
            where=str(workspace.path(KIND, title)),
            todo=f"There {'is seed' if len(there) == 1 else 'are seeds'} {_in_words(there)}.",
        )
    if len(found) > 1:
        found = [folder for folder in found if _made_by(blocks[folder], recipe)] or found
    if len(found) > 1:
        raise InputError(
            f"seed {seed} of {title} was trained more than once: {', '.join(folder.name for folder in found)}.",
            where=str(workspace.path(KIND, title)),
            todo="Give --recipe, or remove the folder that is not meant.",
        )
    return found[0]


_STUDY = ("seeds", "first_seed", "algorithms", "block")
"""What says how a study is cut into blocks, and nothing of how one seed learns."""


def _made_by(manifest: Manifest, recipe: tuple[Settings, ...]) -> bool:
    """Whether the training has the tables of this recipe."""
    made = [_plain(table) for table in manifest.settings.values()]
    return all(_plain(table.model_dump(mode="json")) in made for table in recipe)


def _plain(table: dict[str, object]) -> dict[str, object]:
    return {key: value for key, value in table.items() if key not in _STUDY}


def _in_words(numbers: list[int]) -> str:
    """Numbers as ranges: 0 to 7, 12."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][-1] + 1:
            ranges[-1] = [ranges[-1][0], number]
        else:
            ranges.append([number])
    return ", ".join(" to ".join(str(end) for end in part) for part in ranges) or "none"
