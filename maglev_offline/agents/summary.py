"""How the policies of a training did, beside the classical controllers, scored by the same cost on the same starts."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from maglev_offline.agents.settings import EvaluationSettings
from maglev_offline.control.metrics import response_metrics
from maglev_offline.control.reference import feedback_laws, period_s
from maglev_offline.control.settings import ControllerName, ControlSettings
from maglev_offline.control.simulate import regulate
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

CLASSICAL: tuple[ControllerName, ...] = ("lqr_held", "lqr", "lqi", "pid")
"""The references: `lqr_held` decides once a control period, as an agent does, the others at every plant step."""

HALF_MM = 0.5e-3

COLUMNS = ("policy", "return", "settles (s)", "overshoot", "bias (mm)", "within 0.5 mm")


class Spread(NamedTuple):
    """Median, least and greatest over seeds, in SI units. A response that never settles does so at infinity."""

    median: float
    least: float
    greatest: float

    @classmethod
    def of(cls, values: Iterable[float], missing: float = np.nan) -> "Spread":
        """The spread of values, NaN among them taken for `missing`."""
        found = np.array([missing if np.isnan(value) else value for value in values])
        return cls(_median(found), float(found.min()), float(found.max()))

    def plain(self) -> dict[str, float | None]:
        """For scripts; what is not finite is null."""
        return {name: float(x) if np.isfinite(x) else None for name, x in self._asdict().items()}


class Standing(NamedTuple):
    """One row of the table: a policy of an arm over its seeds, or a classical controller (`seeds` 0).

    `reward` is the return: minus the cost, mean over the reported starts. Settling time, overshoot and bias are those
    from the reference start. `within`: for how many seeds no start's error exceeds half a millimetre in the end.
    """

    policy: str
    seeds: int
    reward: Spread
    settling_time_s: Spread
    overshoot: Spread
    bias_m: Spread
    within: int

    def plain(self) -> dict[str, Any]:
        """For scripts."""
        return {
            "policy": self.policy,
            "seeds": self.seeds,
            "return": self.reward.plain(),
            "settling_time_s": self.settling_time_s.plain(),
            "overshoot": self.overshoot.plain(),
            "steady_state_bias_m": self.bias_m.plain(),
            "within_half_mm": self.within,
        }

    def cells(self) -> list[str]:
        """For people: `COLUMNS`, as median (least..greatest)."""
        return [
            self.policy,
            _words(self.reward, "{:.1f}"),
            _words(self.settling_time_s, "{:.2f}"),
            _words(self.overshoot, "{:.0%}"),
            _words(Spread(*(1e3 * x for x in self.bias_m)), "{:+.2f}"),
            f"{self.within} of {self.seeds}" if self.seeds else "yes" if self.within else "no",
        ]


def policies(curves: pd.DataFrame) -> list[Standing]:
    """The last and the best policies of each arm in the learning curves; the best is chosen on the selection starts."""
    found = []
    for (algorithm, arm), group in curves.groupby(["algorithm", "arm"], sort=False):
        of_seed = group.sort_values("env_step").groupby("seed")
        last = group.loc[[part.index[-1] for _, part in of_seed]]
        best = group.loc[of_seed["selection_cost"].idxmin()]
        found += [_standing(f"{algorithm}-{arm}, {which}", len(t), t) for which, t in (("last", last), ("best", best))]
    return found


def classical(plant: Plant, mdp: Mdp, evaluation: EvaluationSettings, control: ControlSettings) -> list[Standing]:
    """The classical controllers on the nonlinear plant with its voltage limit, for one episode from the same starts."""
    laws = feedback_laws(plant, mdp, control, mdp.voltage_limit_v)
    starts = np.array(evaluation.start_gaps_m)
    reference = evaluation.start_gaps_m.index(evaluation.reference_start_gap_m)
    found = []
    for name in CLASSICAL:
        response = regulate(
            plant, mdp, laws[name], starts, mdp.episode_duration_s, control_period_s=period_s(name, mdp)
        )
        of = response_metrics(plant, mdp, response)
        row = {
            "return": -of["cost"].mean(),
            "worst_error_m": of["steady_state_error_m"].max(),
            **{key: of[key][reference] for key in ("settling_time_s", "overshoot", "steady_state_bias_m")},
        }
        held = f" every {mdp.control_period_ms:g} ms" if name == "lqr_held" else ""
        found.append(_standing(f"{name.removesuffix('_held').upper()}{held}", 0, pd.DataFrame([row])))
    return found


def _standing(name: str, seeds: int, table: pd.DataFrame) -> Standing:
    return Standing(
        name,
        seeds,
        Spread.of(table["return"]),
        Spread.of(table["settling_time_s"], missing=np.inf),
        Spread.of(table["overshoot"]),
        Spread.of(table["steady_state_bias_m"]),
        int((table["worst_error_m"] <= HALF_MM).sum()),
    )


def _median(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    """The median; between a number and infinity it is infinity, and among infinities too."""
    middle = np.sort(values)[[(len(values) - 1) // 2, len(values) // 2]]
    return float(middle.mean()) if np.isfinite(middle).all() else float(middle[1])


def _words(spread: Spread, form: str) -> str:
    def one(x: float) -> str:
        return "never" if x == np.inf else "-" if np.isnan(x) else form.format(x)

    if spread.least == spread.greatest or np.isnan(spread.median):
        return one(spread.median)
    return f"{one(spread.median)} ({one(spread.least)}..{one(spread.greatest)})"
