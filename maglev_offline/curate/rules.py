"""Rows that a recipe names: `[[curate.include]]` and `[[curate.exclude]]`, by ranges of columns and by lists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from maglev_offline.settings import Settings

if TYPE_CHECKING:  # recipes are read without pandas
    import pandas as pd

Mask = NDArray[np.bool_]
Range = tuple[float, float]


class Rule(Settings):
    """A row fits where it fits all that is given: ranges [smallest, largest], both ends included, in the unit of the
    name, and lists of names. The columns are those of the table of transitions.
    """

    gap_error_m: Range | None = None
    gap_velocity_m_s: Range | None = None
    current_error_a: Range | None = None
    voltage_deviation_v: Range | None = None
    cost: Range | None = None
    duration_s: Range | None = None
    log_id: tuple[str, ...] | None = None
    point: tuple[str, ...] | None = None

    @model_validator(mode="after")
    def _says_something(self) -> Rule:
        given = self.model_dump(exclude_none=True)
        if not given:
            raise ValueError("a rule needs a range of a column, or a list of log_id or point")
        for name, value in given.items():
            if name not in ("log_id", "point") and value[0] > value[1]:
                raise ValueError(f"{name} must be [smallest, largest], not [{value[0]:g}, {value[1]:g}]")
            if not value:
                raise ValueError(f"{name} must name one at least")
        return self


def fits(table: pd.DataFrame, rule: Rule) -> Mask:
    """Which rows of a table of transitions fit the rule, shape [n]; NaN fits no range."""
    found = np.ones(len(table), dtype=np.bool_)
    for name, value in rule.model_dump(exclude_none=True).items():
        column = table[name]
        if name in ("log_id", "point"):
            found &= column.isin(value).to_numpy()
        else:
            numbers = column.to_numpy()
            found &= (numbers >= value[0]) & (numbers <= value[1])
    return found


def left_out_by(table: pd.DataFrame, include: Sequence[Rule], exclude: Sequence[Rule]) -> tuple[Mask, Mask]:
    """Which rows fit an exclude rule, and which fit none of the include rules (if there are any); shapes [n]."""
    excluded = np.zeros(len(table), dtype=np.bool_)
    for rule in exclude:
        excluded |= fits(table, rule)
    if not include:
        return excluded, np.zeros_like(excluded)
    included = np.zeros_like(excluded)
    for rule in include:
        included |= fits(table, rule)
    return excluded, ~included
