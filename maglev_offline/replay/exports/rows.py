"""A prefill as other libraries mean it: reward instead of cost, and every row an episode of its own."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maglev_offline.errors import InputError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.checks import refuse_not_finite, refuse_wide_actions

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]

_FURTHEST = 10.0
"""A gap error of so many times the plant's travel is no gap error in metres. Logs of another plant stay below it."""


class Rows(NamedTuple):
    """Rows in slot order, all of one episode each, since balanced rows do not follow one another.

    `observation`, `next_observation` [n, 3] over the recipe's scales, `action` [n, 1] in [-1, 1], `reward` [n] (minus
    the cost), `discount` [n] (what multiplies the value of the next state), float32; `terminated` [n]: there is no next
    value; `truncated` [n]: there is one, and the next row is another episode's. Just one of the two is true.
    `construction` is that of all rows.
    """

    observation: Floats
    action: Floats
    reward: Floats
    next_observation: Floats
    discount: Floats
    terminated: Flags
    truncated: Flags
    construction: str
    mdp: Mdp

    @property
    def facts(self) -> dict[str, str | float]:
        """What a reader must know to use the rows: the discount and what states and actions were divided by."""
        mdp = self.mdp
        return {
            "construction": self.construction,
            "gamma": mdp.discount,
            "control_period_ms": mdp.control_period_ms,
            "gap_scale_m": mdp.gap_scale_m,
            "velocity_scale_m_s": mdp.velocity_scale_m_s,
            "current_scale_a": mdp.current_scale_a,
            "voltage_limit_v": mdp.voltage_limit_v,
        }


class Form(NamedTuple):
    """A form: `write` puts the files into a folder; `library` and its version, with which the tests read them.

    `columns`: from our column to where it lies. `how`: how to load it, `{path}` for the folder. `packages`: what
    writes the bytes, besides our own dependencies.
    """

    write: Callable[[Rows, Path], None]
    library: str
    columns: Mapping[str, str]
    how: str
    packages: tuple[str, ...] = ()


def as_rows(columns: Mapping[str, NDArray[Any]], construction: str, plant: Plant, mdp: Mdp) -> Rows:
    """Turn the columns of a prefill into rows for others.

    Raises
    ------
    InputError: a value is not finite, an action lies outside [-1, 1], or the states were scaled twice.
    """
    where = "prefill"
    names = ("observation", "action", "cost", "next_observation", "discount")
    refuse_not_finite({name: columns[name] for name in names}, where)
    refuse_wide_actions(columns["action"], where)
    for name in ("observation", "next_observation"):
        refuse_scaled_twice(columns[name], name, plant, mdp)
    observation, action, cost, following, discount = (
        np.ascontiguousarray(columns[name], dtype=np.float32) for name in names
    )
    terminated = columns["terminated"].astype(bool)
    return Rows(
        observation, action[:, None], -cost, following, discount, terminated, ~terminated, construction, mdp
    )  # fmt: skip


def refuse_scaled_twice(observation: NDArray[Any], name: str, plant: Plant, mdp: Mdp) -> None:
    """Refuse observations [n, 3] whose gap error is no length that the plant knows.

    Scaled twice, a gap error of a millimetre is one of 0.4 m (by the default scale): far beyond any travel.

    Raises
    ------
    InputError: a gap error is more than ten times the travel between the stops.
    """
    gap_error_m = np.abs(observation[:, 0].astype(float)) * mdp.gap_scale_m
    furthest_m = _FURTHEST * (plant.gap_max_m - plant.gap_min_m)
    if gap_error_m.max(initial=0) > furthest_m:
        row = int(gap_error_m.argmax())
        raise InputError(
            f"row {row}, column {name}: a gap error of {gap_error_m[row]:.3g} m, and the magnet travels "
            f"{plant.gap_max_m - plant.gap_min_m:.3g} m: it was scaled twice, or never was in metres.",
            where="prefill",
            todo="Start from the curated transitions, which are in SI units: run `maglev-offline curate`.",
        )


def refuse_own_discounts(rows: Rows, library: str) -> None:
    """Refuse rows that carry another discount than the process, for a library that has one for all rows.

    Raises
    ------
    InputError: there is such a row; the first, and the construction that made it, are named.
    """
    own = ~rows.terminated & ~np.isclose(rows.discount, rows.mdp.discount, rtol=1e-5, atol=0)
    if own.any():
        row = int(own.argmax())
        raise InputError(
            f"{own.sum():,} rows of the construction {rows.construction} carry a discount of their own "
            f"(row {row}: {rows.discount[row]:.4g}, and the process has {rows.mdp.discount:g}); "
            f"{library} has one discount for all rows.",
            where="prefill",
            todo="Use --format npz or torchrl, which hold it, or curate with another --construction.",
        )
