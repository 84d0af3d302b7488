"""What the recovery goes by. Imports no pandas: an unchanged run needs none."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from maglev_offline.control.pid import CascadeGains, PidGains, cascade, pid
from maglev_offline.curate.recovery.settings import LawName, RecoverySettings
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Belief:
    """What the recovery goes by: settings, and the gains of the laws that it may try."""

    settings: RecoverySettings = field(default_factory=RecoverySettings)
    pid: PidGains = field(default_factory=PidGains)
    cascade: CascadeGains = field(default_factory=CascadeGains)

    def gain(self, plant: Plant, law: LawName) -> Array | None:
        """Gain [4] of (z1, z2, z3, integral), or None where no law is known."""
        if law == "none":
            return None
        return (pid(self.pid) if law == "pid" else cascade(plant, self.cascade)).gain
