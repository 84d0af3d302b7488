"""What is wrong with the columns of a prefill, said with the row and the column."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.errors import InputError


def refuse_not_finite(columns: Mapping[str, NDArray[Any]], where: str) -> None:
    """Refuse numbers that are not finite, in columns [n] or [n, k].

    Raises
    ------
    InputError: there is one; the first is named.
    """
    for name, column in columns.items():
        bad = ~np.isfinite(column.astype(float)).all(axis=tuple(range(1, column.ndim)))
        if bad.any():
            raise InputError(
                f"row {bad.argmax()}, column {name}: the value is not finite ({bad.sum()} such rows).",
                where=where,
                todo="Curate again: it leaves such rows out.",
            )


def refuse_wide_actions(action: NDArray[Any], where: str) -> None:
    """Refuse actions [n] or [n, 1] that leave [-1, 1].

    Raises
    ------
    InputError: there is one; the first is named.
    """
    outside = (np.abs(action) > 1).any(axis=tuple(range(1, action.ndim)))
    if outside.any():
        row = int(outside.argmax())
        raise InputError(
            f"row {row}, column action: {float(action.reshape(-1)[row]):.4g} lies outside [-1, 1] "
            f"({outside.sum()} such rows).",
            where=where,
            todo="An action is the voltage deviation over mdp.voltage_limit_v; divide by it once.",
        )


def refuse_small_capacity(rows: int, capacity: int, where: str) -> None:
    """Refuse a buffer that has not one slot left for the agent's own experience.

    Raises
    ------
    InputError: it has none.
    """
    if rows >= capacity:
        raise InputError(
            f"{rows:,} prefilled rows do not fit into {capacity:,} slots with room for new ones.",
            where=where,
            todo="Take a larger buffer (training.buffer_capacity), or fewer rows (prefill.rows).",
        )
