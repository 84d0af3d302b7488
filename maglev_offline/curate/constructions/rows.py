"""The table that every construction makes."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline import mdp as process
from maglev_offline.curate.pairs import Pairs
from maglev_offline.mdp import Mdp

Array = NDArray[np.float64]

STATE = process.STATE_NAMES
"""The three columns of the state s, relative to the equilibrium at the row's own set-point."""

NEXT_STATE = tuple(f"next_{name}" for name in STATE)
"""The three columns of s', relative to the same set-point; stored, never implied by the next row."""

NAMES = ("origin", "log_id", "point")
"""The columns of text, with few values."""


class Rows(NamedTuple):
    """What a construction says of m rows, in SI units; `cost` holds no contact penalty, `discount` no termination.

    `state`, `next_state` [m, 3]; `voltage_v` (v = u - u_eq), `cost`, `duration_s`, `discount` [m]; `touches`, `last`
    [m] as in `Pairs`; `pair` and `substep` [m]: the row is the substep-th of that pair. `uncertainty` [m], where
    the construction reckons with one, as in `table_of`.
    """

    state: Array
    voltage_v: Array
    cost: Array
    next_state: Array
    duration_s: Array
    discount: Array
    touches: NDArray[np.bool_]
    last: NDArray[np.bool_]
    pair: NDArray[np.int64]
    substep: NDArray[np.int64]
    uncertainty: Array | None = None


def one_row_a_pair(
    pairs: Pairs,
    *,
    cost: Array,
    discount: Array,
    next_state: Array | None = None,
    duration_s: Array | None = None,
    touches: NDArray[np.bool_] | None = None,
) -> Rows:
    """A row for each pair with its state and voltage as logged; so is what is not given."""
    n = len(pairs)
    return Rows(
        state=pairs.state,
        voltage_v=pairs.voltage_v,
        cost=cost,
        next_state=pairs.next_state if next_state is None else next_state,
        duration_s=pairs.duration_s if duration_s is None else duration_s,
        discount=discount,
        touches=pairs.touches if touches is None else touches,
        last=pairs.last,
        pair=np.arange(n),
        substep=np.zeros(n, dtype=np.int64),
    )


def table_of(rows: Rows, pairs: Pairs, mdp: Mdp, origin: str) -> pd.DataFrame:
    """Lay rows out as the table of transitions.

    Columns: those of `STATE`, `voltage_deviation_v`, `cost` (with the contact penalty), those of `NEXT_STATE`,
    `duration_s`, `discount` (0 where the process ends), `terminated` (contact, where the process ends there),
    `truncated` (last of its segment), `origin`, `uncertainty`, `log_id`, `point`, `t` (when the row begins), `segment`,
    `step`, `substep`. Names (`NAMES`) are categories: as text they are a third of a table of millions of rows.

    `uncertainty` is the root of the mean variance of the state's three numbers, each over its `mdp.state_scale`: null
    where the construction does not reckon with any, infinite where the state is not to be believed.
    """
    terminated = rows.touches & mdp.terminate_on_contact
    table = pd.DataFrame(dict(zip(STATE, rows.state.T, strict=True)))
    table["voltage_deviation_v"] = rows.voltage_v
    table["cost"] = rows.cost + mdp.contact_penalty * rows.touches
    table = table.assign(**dict(zip(NEXT_STATE, rows.next_state.T, strict=True)))
    table["duration_s"] = rows.duration_s
    table["discount"] = rows.discount * ~terminated
    table["terminated"] = terminated
    table["truncated"] = rows.last & ~terminated
    table["origin"] = pd.Categorical.from_codes(np.zeros(len(table), dtype=np.int8), pd.Index([origin]))
    table["uncertainty"] = np.nan if rows.uncertainty is None else rows.uncertainty
    place = pairs.place.astype(dict.fromkeys(("log_id", "point"), "category")).iloc[rows.pair].reset_index(drop=True)
    begins_ns = np.rint(rows.substep * mdp.control_period_ms * 1e6).astype(np.int64)
    place["t"] = place["t"] + pd.to_timedelta(begins_ns, unit="ns")
    table = pd.concat([table, place], axis=1)
    table["substep"] = rows.substep.astype(np.int32)
    return table
