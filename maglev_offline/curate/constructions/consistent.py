"""`consistent`: interpolated rows, of which curation keeps those that the plant explains."""

import pandas as pd

from maglev_offline.curate.constructions.interpolated import interpolated_rows
from maglev_offline.curate.pairs import Pairs
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


def consistent_rows(pairs: Pairs, plant: Plant, mdp: Mdp) -> pd.DataFrame:
    """The rows of `interpolated` under another name.

    The filter (`CurateSettings.share_kept` of the usable rows, by `consistency.one_step_residual`) comes after those
    that cannot be used are left out, and is the same that `consistent_fraction` puts on any construction.
    """
    table = interpolated_rows(pairs, plant, mdp)
    table["origin"] = table["origin"].cat.rename_categories(["consistent"])
    return table
