"""The prefill: curated transitions, scaled as the agent will see its own, in slot order."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from maglev_offline import mdp as process
from maglev_offline.curate.transitions import NEXT_STATE, STATE
from maglev_offline.errors import ArtefactError, InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.checks import refuse_not_finite, refuse_small_capacity
from maglev_offline.replay.settings import PrefillSettings
from maglev_offline.streams import stream
from maglev_offline.workspace import Manifest, Workspace, fingerprint, input_hash

Columns = dict[str, NDArray[Any]]

LAYOUT = 2
"""Version of the file's layout, so that a prefill of an older one is made again. 1 held observations out of order."""

_NUMBERS = (*STATE, "voltage_deviation_v", "cost", *NEXT_STATE, "discount")

FIELDS = ("observation", "action", "cost", "next_observation", "discount")


def scaled(transitions: pd.DataFrame, mdp: Mdp) -> Columns:
    """Scale transitions to what DDPG and TD3 store.

    Returns `observation` and `next_observation` [n, 3] over the state scales, `action` [n] in [-1, 1], `cost` [n],
    `discount` [n], `terminated` and `truncated` [n], float32 and bool. The discount is the row's own, and 0 where the
    process ends.

    Raises
    ------
    InputError: a value is not finite, or an action lies outside [-1, 1]; the first such row is named.
    """
    refuse_not_finite({name: transitions[name].to_numpy() for name in _NUMBERS}, "prefill")
    act = process.action(mdp, transitions["voltage_deviation_v"].to_numpy())
    terminated = transitions["terminated"].to_numpy(dtype=bool)
    columns: Columns = {
        "observation": process.observation(mdp, transitions[list(STATE)].to_numpy()),
        "action": act,
        "cost": transitions["cost"].to_numpy(),
        "next_observation": process.observation(mdp, transitions[list(NEXT_STATE)].to_numpy()),
        "discount": transitions["discount"].to_numpy() * ~terminated,
    }
    if np.abs(act).max(initial=0) > 1:
        row = int(np.abs(act).argmax())
        raise InputError(
            f"row {row}, column voltage_deviation_v: {abs(act[row]):.3g} times the voltage limit of "
            f"{mdp.voltage_limit_v:g} V.",
            where="prefill",
            todo="Raise mdp.voltage_limit_v, or curate again with this recipe.",
        )
    columns = {name: np.ascontiguousarray(column, dtype=np.float32) for name, column in columns.items()}
    columns["terminated"] = terminated
    columns["truncated"] = transitions["truncated"].to_numpy(dtype=bool)
    return columns


def make_prefill(
    workspace: Workspace,
    algorithm: str,
    settings: PrefillSettings,
    plant: Plant,
    mdp: Mdp,
    *,
    capacity: int | None = None,
    source: Path | None = None,
    home: Path | None = None,
) -> tuple[Path, bool]:
    """Make the artefact `prefill/<algorithm>` from the curated transitions; return its folder and whether it is new.

    `capacity`: slots of the buffer that it is for. `source`, `home`: other transitions than the workspace's, and
    another place for the artefact, below the workspace.

    Raises
    ------
    ArtefactError: there are no curated transitions, or they were made with another plant or decision process.
    InputError: the rows do not fit into `capacity`, or cannot be scaled.
    """
    source, home = source or workspace.path("transitions"), home or workspace.path("prefill", algorithm)
    made = fitting_transitions(source, plant, mdp)
    inputs = {source.relative_to(workspace.root).as_posix(): input_hash(source)}
    if capacity is not None:
        rows = made.counts["transitions"]
        refuse_small_capacity(rows if settings.rows is None else min(rows, settings.rows), capacity, "prefill")
    mark = fingerprint("prefill", inputs, settings, mdp, algorithm=algorithm, layout=LAYOUT)
    if workspace.is_current(home, mark):
        return home, False

    table = read_transitions(source)
    slots = np.arange(len(table))
    if settings.rows is not None and settings.rows < len(slots):
        slots = np.sort(stream(settings.seed, "prefill: rows").choice(slots, settings.rows, replace=False))
    columns = scaled(table.iloc[slots], mdp)
    columns["transition_row"] = slots.astype(np.int64)

    manifest = Manifest(home.relative_to(workspace.root).as_posix(), mark, inputs)
    manifest.settings = {"prefill": settings.model_dump(mode="json"), "mdp": mdp.model_dump(mode="json")}
    manifest.counts = {"transitions": len(table), "rows": len(slots)}
    manifest.left_out = {"over_prefill_rows": len(table) - len(slots)}
    manifest.facts = {
        "algorithm": algorithm,
        "mean_cost": float(columns["cost"].astype(float).mean()),
        "largest_action": float(np.abs(columns["action"]).max()),
    }
    with workspace.commit(home, manifest) as draft:
        # safetensors writes memory as it lies: an array in Fortran order, as pandas gives, comes back scrambled.
        save_file({k: np.ascontiguousarray(v) for k, v in columns.items()}, draft / "prefill.safetensors")
    return home, True


def fitting_transitions(source: Path, plant: Plant, mdp: Mdp) -> Manifest:
    """The manifest of the transitions in `source`, which were curated for this plant and decision process.

    Raises
    ------
    ArtefactError: there are none, or they were curated for others.
    """
    if not (source / "manifest.json").is_file():
        raise ArtefactError(
            "there are no curated transitions in the workspace.",
            where=str(source.parent),
            todo="Run `maglev-offline ingest LOGS...` first.",
        )
    made = Manifest.read(source)
    if made.settings["plant"] != plant.model_dump(mode="json") or made.settings["mdp"] != mdp.model_dump(mode="json"):
        raise ArtefactError(
            "the transitions were curated with another [plant] or [mdp] than this recipe has.",
            where=str(source),
            todo="Run `maglev-offline curate` with this recipe, then try again.",
        )
    return made


def read_transitions(source: Path) -> pd.DataFrame:
    """Read the curated rows of an artefact of transitions; raises ArtefactError where they cannot be read."""
    try:
        return pd.read_parquet(source / "transitions.parquet")
    except (OSError, ValueError) as error:
        raise ArtefactError(
            f"the curated transitions cannot be read ({error}).",
            where=str(source),
            todo="Run `maglev-offline curate` again.",
        ) from None


def load_prefill(folder: Path) -> Columns:
    """Read the columns of a prefill artefact, in slot order.

    Raises
    ------
    ArtefactError: there is no prefill in `folder`, or it is damaged.
    """
    path = folder / "prefill.safetensors"
    if not path.is_file():
        raise ArtefactError(
            "there is no prefill.",
            where=str(folder),
            todo=f"Run `maglev-offline prefill --algo {folder.name}` first.",
        )
    try:
        columns: Columns = load_file(path)
        _check_columns(columns)
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise ArtefactError(
            f"the prefill cannot be read ({error}).",
            where=str(path),
            todo=f"Remove the folder and run `maglev-offline prefill --algo {folder.name}` again.",
        ) from None
    return columns


def _check_columns(columns: Columns) -> None:
    """Raise ValueError where columns are missing, of other shapes or kinds, or hold what no row has."""
    if missing := [name for name in _SHAPES if name not in columns]:
        raise ValueError(f"{', '.join(missing)} missing")
    rows = len(columns["cost"]) if columns["cost"].ndim else -1
    for name, (width, kind) in _SHAPES.items():
        found = columns[name]
        if found.shape != (rows, *width) or found.dtype != kind:
            raise ValueError(f"{name} is {found.dtype} of shape {found.shape}")
        if kind == np.float32 and not np.isfinite(found).all():
            raise ValueError(f"{name} has values that are not finite")
    if np.abs(columns["action"]).max(initial=0) > 1:
        raise ValueError("an action lies outside [-1, 1]")


_SHAPES: dict[str, tuple[tuple[int, ...], type[np.generic]]] = {
    "observation": ((3,), np.float32),
    "action": ((), np.float32),
    "cost": ((), np.float32),
    "next_observation": ((3,), np.float32),
    "discount": ((), np.float32),
    "terminated": ((), np.bool_),
    "truncated": ((), np.bool_),
    "transition_row": ((), np.int64),
}


def packed(columns: Columns) -> NDArray[np.float32]:
    """Pack the columns of a prefill into rows [n, WIDTH] for `ReplayBuffer.prefill`; no row is followed by the next."""
    from maglev_offline.replay.buffer import pack

    last = np.ones(len(columns["action"]), dtype=bool)
    observation, action, cost, following, discount = (columns[name] for name in FIELDS)
    return pack(observation, action, cost, following, discount, last)
