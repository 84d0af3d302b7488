"""How rows are made from pairs of samples: a pure function for each construction, by the name a recipe gives it."""

from collections.abc import Callable

import pandas as pd

from maglev_offline.curate.constructions.consistent import consistent_rows
from maglev_offline.curate.constructions.interpolated import interpolated_rows
from maglev_offline.curate.constructions.raw import raw_rows
from maglev_offline.curate.constructions.reconstructed import reconstructed_rows
from maglev_offline.curate.constructions.semi_markov import semi_markov_rows
from maglev_offline.curate.constructions.simulated_next import simulated_next_rows
from maglev_offline.curate.pairs import Pairs
from maglev_offline.curate.settings import ConstructionName
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

Construction = Callable[[Pairs, Plant, Mdp], pd.DataFrame]
"""Pairs, the plant and the decision process to the table of `rows.table_of`."""

CONSTRUCTIONS: dict[ConstructionName, Construction] = {
    "raw": raw_rows,
    "semi_markov": semi_markov_rows,
    "interpolated": interpolated_rows,
    "consistent": consistent_rows,
    "reconstructed": reconstructed_rows,
    "simulated_next": simulated_next_rows,
}
