"""What a run leaves behind: its evaluations, its best and its last actors, and where a seed diverged."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.agents.divergence import diverged
from maglev_offline.agents.engine import Learner, Nets
from maglev_offline.agents.evaluation import judge, regulation
from maglev_offline.agents.settings import EvaluationSettings
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


class Trained(NamedTuple):
    """What a block of seeds ends with.

    `curves`: one row for a seed and an evaluation. `last` and `best`: the actors, numpy, leading axis [seeds];
    `best` is chosen on the selection starts alone. `regulation`: responses of the last actors from the reference start.
    `diverged_at`: the step at which a seed's divergence was seen, for those seeds that did.
    """

    seeds: list[int]
    curves: pd.DataFrame
    regulation: pd.DataFrame
    last: Nets
    best: Nets
    diverged_at: dict[int, int]


class Record:
    """Collects the evaluations of a block, keeps the best actor of each seed, and marks those that diverge.

    A seed that diverged is judged like any other and stays in the curves, marked from then on.
    """

    def __init__(
        self, seeds: list[int], plant: Plant, mdp: Mdp, evaluation: EvaluationSettings, root_offset: float
    ) -> None:
        self.seeds, self.plant, self.mdp, self.evaluation = seeds, plant, mdp, evaluation
        self.root_offset = root_offset
        self.tables: list[pd.DataFrame] = []
        self.best_cost = np.full(len(seeds), np.inf)
        self.best: Nets = {}
        self.diverged_at = np.full(len(seeds), -1)

    def watch(self, learner: Learner) -> None:
        """Mark the seeds that have diverged by now."""
        starts = np.array(self.evaluation.start_gaps_m)
        found = diverged(learner.actors(), learner.critics(), self.plant, self.mdp, starts, self.root_offset)
        self.diverged_at[found & (self.diverged_at < 0)] = learner.step

    def take(self, learner: Learner) -> pd.DataFrame:
        """Judge the actors as they are now; return the new rows of the curves, one for a seed."""
        self.last = learner.actors()
        self.response = learner.responses(self.evaluation.all_starts_m)
        table = judge(self.response, self.last, self.plant, self.mdp, self.evaluation)
        table["diverged"] |= self.diverged_at >= 0
        table.insert(0, "seed", self.seeds)
        table.insert(1, "env_step", learner.step)
        self.tables.append(table)
        better = table["selection_cost"].to_numpy() < self.best_cost
        self.best_cost = np.where(better, table["selection_cost"], self.best_cost)
        for name, value in self.last.items():
            kept = self.best.get(name, value)
            self.best[name] = np.where(better.reshape(-1, *[1] * (value.ndim - 1)), value, kept)
        return table

    def state(self) -> dict[str, NDArray[Any]]:
        """What a checkpoint has to hold of this; the last actors and responses come anew with the last evaluation."""
        curves = pd.concat(self.tables)
        return {
            "best_cost": self.best_cost,
            "diverged_at": self.diverged_at,
            **{f"best.{name}": value for name, value in self.best.items()},
            **{f"curves.{place:02d}.{name}": curves[name].to_numpy() for place, name in enumerate(curves)},
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on where `state` was taken."""
        self.best_cost, self.diverged_at = state["best_cost"].copy(), state["diverged_at"].copy()
        self.best = {name.removeprefix("best."): x.copy() for name, x in state.items() if name.startswith("best.")}
        columns = sorted(name for name in state if name.startswith("curves."))
        self.tables = [pd.DataFrame({name.split(".", 2)[2]: state[name] for name in columns})]

    def result(self) -> Trained:
        """All of it; there has to have been an evaluation."""
        curves = pd.concat(self.tables).sort_values(["seed", "env_step"], ignore_index=True)
        responses = regulation(self.response, self.seeds, self.evaluation)
        found = {seed: int(at) for seed, at in zip(self.seeds, self.diverged_at, strict=True) if at >= 0}
        return Trained(self.seeds, curves, responses, self.last, self.best, found)
