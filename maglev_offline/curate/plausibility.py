"""Do the logs speak of the plant that the recipe describes? A wrong unit or another plant shows in the medians."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

FACTOR = 2.0
"""How far a median may be from what the plant says before it is doubted, as a factor either way."""


def implausible(samples: pd.DataFrame, plant: Plant) -> list[str]:
    """Say in words where the median sample does not fit the plant; an empty list where it does.

    Judged are the gap against the set-point, the current against the one that carries the mass at that gap (at the
    set-point, where the gap itself is in doubt), and the voltage over the current against the resistance; rows in
    contact with a stop, without current, or with a value that is not finite, are left out.
    """
    columns = ["gap_m", "set_point_m", "current_a", "voltage_v"]
    values = samples.loc[~samples["contact"].astype(bool), columns].to_numpy(dtype=np.float64)
    gap, set_point, current, voltage = values[np.isfinite(values).all(axis=1)].T
    doubts = _doubts("gap", "m", gap, set_point, "the set-point")
    at, where = (set_point, "the set-point") if doubts else (gap, "the logged gap")
    carried = np.asarray(plant.equilibrium(at).current_a)
    on = current > 0.1 * carried
    if len(gap) and not on.any():
        return [
            *doubts,
            f"the logged current (median {np.median(current):.3g} A) is nowhere near the one that carries "
            f"{plant.mass_kg:g} kg ({np.median(carried):.3g} A): is its unit right, and is [plant] that of the logs?",
        ]
    resistance = np.full(int(on.sum()), plant.resistance_ohm)
    return [
        *doubts,
        *_doubts("current", "A", current[on], carried[on], f"what carries {plant.mass_kg:g} kg at {where}"),
        *_doubts("voltage over current", "ohm", voltage[on] / current[on], resistance, "the resistance of [plant]"),
    ]


def _doubts(name: str, unit: str, logged: Array, expected: Array, meaning: str) -> list[str]:
    if not len(logged):
        return []
    found, wanted = np.median(logged), np.median(expected)
    if wanted / FACTOR <= found <= wanted * FACTOR:
        return []
    return [
        f"the logged {name} (median {found:.3g} {unit}) does not fit {meaning} ({wanted:.3g} {unit}): is its unit "
        "right, and is [plant] that of the logs?"
    ]
