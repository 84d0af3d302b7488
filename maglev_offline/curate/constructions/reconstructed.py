"""`reconstructed`: the states and voltages that plant and law say, given all samples of a segment."""

import numpy as np
import pandas as pd

from maglev_offline.curate.constructions.rows import Rows, table_of
from maglev_offline.curate.pairs import Pairs
from maglev_offline.curate.recovery.logs import Recovered, recover_logs
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

RUNAWAY = 20.0
"""State scales beyond which a state is that of a linearised arc that ran away between two samples."""


def reconstructed_rows(pairs: Pairs, plant: Plant, mdp: Mdp, recovered: Recovered | None = None) -> pd.DataFrame:
    """As many rows a pair as it has whole control periods, each between two smoothed states, with its uncertainty.

    `recovered`: what was found of `pairs.samples` (not given: with the defaults of `[curate.recovery]`).

    The logged law moves the voltage within a control period, and a row says that it was held: it is given the mean
    of the voltage over the period, which takes the current to the same end but for what the coil loses, of the order
    of R T / L; what is left is of second order in the period times the law's rate. (The voltage at the
    beginning is wrong in first order.) The next state is the smoothed one: with it come the forces that acted.

    A pair that was not recovered (it ends in contact, a number is missing, or it is shorter than a control period)
    gives one row as logged of null uncertainty, one of a segment that the plant does not explain rows of infinite
    uncertainty. `unusable` leaves out both.
    """
    found = recover_logs(pairs.samples, plant, mdp) if recovered is None else recovered
    periods = found.periods
    pair = np.searchsorted(pairs.row, periods.sample)
    other = np.setdiff1d(np.arange(len(pairs)), pair)
    std = np.maximum(periods.std, periods.next_std)
    uncertainty = np.sqrt(np.mean((std / mdp.state_scale) ** 2, axis=1))
    states = np.concatenate([periods.state, periods.next_state], axis=1) / np.tile(mdp.state_scale, 2)
    uncertainty[~found.explained | (np.abs(states) > RUNAWAY).any(axis=1)] = np.inf
    all_pairs = np.concatenate([pair, other])
    order = np.argsort(all_pairs, kind="stable")
    period_s = mdp.plant_steps_per_decision * mdp.plant_step_s

    def joined(smoothed: np.ndarray, logged: np.ndarray) -> np.ndarray:
        return np.concatenate([smoothed, logged])[order]

    rows = Rows(
        state=joined(periods.state, pairs.state[other]),
        voltage_v=joined(periods.voltage_v, pairs.voltage_v[other]),
        cost=joined(periods.cost, np.zeros(len(other))),
        next_state=joined(periods.next_state, pairs.next_state[other]),
        duration_s=joined(np.full(len(pair), period_s), pairs.duration_s[other]),
        discount=np.full(len(order), mdp.discount),
        touches=joined(np.zeros(len(pair), dtype=bool), pairs.touches[other]),
        last=np.zeros(len(order), dtype=bool),
        pair=all_pairs[order],
        substep=joined(periods.substep, np.zeros(len(other), dtype=np.int64)),
        uncertainty=joined(uncertainty, np.full(len(other), np.nan)),
    )
    final = np.append(rows.pair[1:] != rows.pair[:-1], True)[: len(order)]
    return table_of(rows._replace(last=pairs.last[rows.pair] & final), pairs, mdp, "reconstructed")
