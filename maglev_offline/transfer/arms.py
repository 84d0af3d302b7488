"""What an arm is made of: the recipe's own tables, and what the arm has otherwise."""

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeVar

from pydantic import ValidationError

from maglev_offline.agents.settings import TrainingSettings
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.errors import RecipeError
from maglev_offline.settings import Settings
from maglev_offline.transfer.settings import RowsFrom, TransferSettings

SAME_IN_ALL_ARMS = (
    "algorithms", "seeds", "first_seed", "block", "engine", "checkpoint_every", "steps", "exploratory_steps",
    "exploratory_hold_ms", "batch_size",
)  # fmt: skip
"""An arm that learned for longer, from other seeds, or more rows a step, would be another experiment."""

Table = TypeVar("Table", bound=Settings)


class Plan(NamedTuple):
    """An arm with all its numbers filled in. `curate`: the table for its rows; None where they are the recipe's own."""

    name: str
    rows: RowsFrom
    curate: CurateSettings | None
    training: TrainingSettings


def plan_of(name: str, settings: TransferSettings, curate: CurateSettings, training: TrainingSettings) -> Plan:
    """Fill in the arm `name` of the recipe.

    Raises
    ------
    RecipeError: there is no such arm, or its own keys are unknown, cannot be, or must be the same in all arms.
    """
    known = settings.known_arms
    if name not in known:
        raise RecipeError(
            f"there is no arm {name!r}.",
            where="[transfer] arms",
            todo=f"Name one of {', '.join(known)}, or describe it in [transfer.arm.{name}].",
        )
    arm = known[name]
    where = f"[transfer.arm.{name}.training]"
    for key in arm.training:
        if key in SAME_IN_ALL_ARMS:
            raise RecipeError(
                f"{key} must be the same in all arms.", where=where, todo="Set it in [training], for every arm."
            )
    return Plan(
        name,
        arm.rows,
        _with(curate, arm.curate, f"[transfer.arm.{name}.curate]") if arm.curate else None,
        _with(training, arm.training, where),
    )


def _merged(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The table with the changes, tables within it merged in the same way."""
    merged = dict(table)
    for key, value in changes.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if both else value
    return merged


def _with(table: Table, changes: Mapping[str, Any], where: str) -> Table:
    if not changes:
        return table
    try:
        return type(table).model_validate(_merged(table.model_dump(), changes))
    except ValidationError as error:
        found = "; ".join(f"{'.'.join(map(str, part['loc'])) or 'table'}: {part['msg']}" for part in error.errors())
        raise RecipeError(f"{found}.", where=where, todo="Correct the recipe; nothing was run.") from None
