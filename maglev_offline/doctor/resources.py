"""Cores, memory and disk against what the trainings of the recipe need."""

import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from maglev_offline.doctor.check import Check
from maglev_offline.machine import free_memory_bytes, total_memory_bytes, usable_cores

if TYPE_CHECKING:
    from maglev_offline.recipe import Recipe

ROW_BYTES = 40
"""A packed row of a replay buffer and of a checkpoint (`replay.buffer.WIDTH` float32)."""

PROCESS_BYTES = 500_000_000
"""What a process takes that trains, beside its rows: Python, PyTorch, pandas."""

ARTEFACT_BYTES = 200_000_000
"""Room for artefacts; the workspace of the demo takes a tenth of it."""


class Needs(NamedTuple):
    """What the trainings of a recipe take at once, with a process for each core."""

    memory_bytes: int
    disk_bytes: int


def needs(recipe: "Recipe | None", cores: int) -> Needs:
    """Rows of all seeds that are trained at once, in memory and as checkpoints; a little where no recipe is known."""
    if recipe is None:
        return Needs(PROCESS_BYTES, ARTEFACT_BYTES)
    training = recipe.training
    arms = max(2, len(recipe.transfer.arms)) * len(training.algorithms)
    blocks = min(cores, arms * -(-training.seeds // training.block))
    rows = blocks * min(training.block, training.seeds) * training.steps * ROW_BYTES
    return Needs(blocks * PROCESS_BYTES + rows, ARTEFACT_BYTES + rows)


def machine(needed: Needs) -> list[Check]:
    """Cores and memory."""
    cores, total, free = usable_cores(), total_memory_bytes(), free_memory_bytes()
    of = os.cpu_count() or cores
    what = f"{cores}" if cores == of else f"{cores} of {of} may be used"
    found = [Check("cores", "cores", "ok", what, "", {"usable": cores, "machine": of})]
    facts = {"total_bytes": total, "free_bytes": free, "needed_bytes": needed.memory_bytes}
    what = f"{_gb(total)}" + (f", {_gb(free)} free" if free is not None else "")
    if (total if free is None else free) >= needed.memory_bytes:
        return [*found, Check("memory", "memory", "ok", what, "", facts)]
    what += f"; trainings of this recipe on all cores may take {_gb(needed.memory_bytes)}"
    todo = "Give train, transfer and run fewer processes (--jobs 1), or wait until other programs end."
    return [*found, Check("memory", "memory", "note", what, todo, facts)]


def disk(folder: Path, needed: Needs) -> Check:
    """Free space where the workspace lies; a note where it is less than three times of what is needed."""
    free = shutil.disk_usage(folder).free
    facts = {"free_bytes": free, "needed_bytes": needed.disk_bytes}
    what = f"{_gb(free)} free at {folder}"
    if free >= 3 * needed.disk_bytes:
        return Check("disk", "disk", "ok", what, "", facts)
    what += f"; the trainings of this recipe may take {_gb(needed.disk_bytes)}"
    todo = "Make room, or take a --workspace on another disk."
    return Check("disk", "disk", "note" if free >= needed.disk_bytes else "problem", what, todo, facts)


def _gb(number: int) -> str:
    return f"{number / 1e9:,.1f} GB"
