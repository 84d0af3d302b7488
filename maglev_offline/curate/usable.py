"""Which rows can be used, and why the others cannot."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from maglev_offline.curate.consistency import inconsistent, one_step_residual
from maglev_offline.curate.constructions import CONSTRUCTIONS
from maglev_offline.curate.constructions.reconstructed import reconstructed_rows
from maglev_offline.curate.pairs import Pairs, pairs_of
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.logs import recover_logs
from maglev_offline.curate.recovery.verdict import pilot, recovery_facts
from maglev_offline.curate.recovery.words import recovery_words
from maglev_offline.curate.rules import fits, left_out_by
from maglev_offline.curate.settings import CurateSettings
from maglev_offline.curate.transitions import unusable
from maglev_offline.errors import ArtefactError
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant


class Usable(NamedTuple):
    """The usable transitions, of how many pairs of samples, and why a row that was made is none (empty: it is one).

    `recovery`: what can be known of states between samples, as `recovery.verdict` says it. `idle_rules`: the rules of
    the recipe that no row fits.
    """

    candidates: pd.DataFrame
    pairs: int
    reason: pd.Series
    recovery: dict[str, Any]
    idle_rules: tuple[str, ...]

    @property
    def unit(self) -> str:
        """What was made: a row for each pair, or several."""
        return "pairs" if len(self.reason) == self.pairs else "rows"


def usable_rows(
    samples: pd.DataFrame, where: str, settings: CurateSettings, plant: Plant, mdp: Mdp, belief: Belief, jobs: int = 1
) -> Usable:
    """Make the rows of the recipe's construction, and say which of them are usable; `where` names the samples.

    `jobs`: parts of the recovery that go on at once.

    Raises
    ------
    ArtefactError: no two samples follow each other, or none of the rows is usable.
    """
    pairs = pairs_of(samples, plant)
    if not len(pairs):
        raise ArtefactError(
            "no two samples follow each other in a segment, so there is no transition.",
            where=where,
            todo="Look at [ingest] longest_bridge_ms against the period of the messages.",
        )
    table, recovery = _made(pairs, settings, plant, mdp, belief, jobs)
    reason = unusable(table, mdp)
    idle_rules = _leave_out_by_rules(table, reason, settings)
    if settings.share_kept is not None:
        _leave_out_inconsistent(table, reason, settings.share_kept, plant, mdp)
    usable = (reason == "").to_numpy()
    candidates = table if usable.all() else table[usable].reset_index(drop=True)
    found = Usable(candidates, len(pairs), reason, recovery, idle_rules)
    if found.candidates.empty:
        known = f"; {recovery_words(recovery)}" if settings.construction == "reconstructed" else ""
        raise ArtefactError(
            f"no usable transition in {len(reason)} {found.unit} of samples ({listing(reason)}{known}).",
            where=where,
            todo=_todo(reason),
        )
    return found


def _made(
    pairs: Pairs, settings: CurateSettings, plant: Plant, mdp: Mdp, belief: Belief, jobs: int
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """The rows of the construction, and the facts of the recovery: of all samples where the rows come from it."""
    if settings.construction == "reconstructed":
        recovered = recover_logs(pairs.samples, plant, mdp, belief, jobs)
        return reconstructed_rows(pairs, plant, mdp, recovered), recovery_facts(pairs.samples, recovered.logs)
    found = pilot(pairs.samples, plant, mdp, belief, jobs)
    return CONSTRUCTIONS[settings.construction](pairs, plant, mdp), recovery_facts(pairs.samples, found)


def _leave_out_by_rules(table: pd.DataFrame, reason: pd.Series, settings: CurateSettings) -> tuple[str, ...]:
    """Give a reason to those usable rows that the rules leave out; return the rules that no row fits."""
    excluded, not_included = left_out_by(table, settings.include, settings.exclude)
    usable = (reason == "").to_numpy()
    reason[usable & not_included] = "not_in_include_rule"
    reason[usable & excluded] = "excluded_by_rule"
    named = {"include": settings.include, "exclude": settings.exclude}
    return tuple(
        f"curate.{name}[{k}]"
        for name, rules in named.items()
        for k, rule in enumerate(rules)
        if not fits(table, rule).any()
    )


def _leave_out_inconsistent(table: pd.DataFrame, reason: pd.Series, fraction: float, plant: Plant, mdp: Mdp) -> None:
    """Give a reason to those usable rows that agree least with the simulator."""
    usable = np.flatnonzero(reason == "")
    marked = inconsistent(one_step_residual(table.iloc[usable], plant, mdp), fraction)
    reason.iloc[usable[marked]] = "inconsistent_with_simulator"


def _todo(reason: pd.Series) -> str:
    if (reason == "not_explained_by_plant").mean() > 0.5:
        return (
            "Is [plant] that of the logs (`maglev-offline identify`), and [curate.recovery] law and noise right? "
            "Otherwise take another [curate] construction."
        )
    if reason.isin(["excluded_by_rule", "not_in_include_rule"]).any():
        return "Check the ranges in [[curate.include]] and [[curate.exclude]]: they are in SI units."
    if (reason == "shorter_than_a_decision").any():
        return (
            "The samples lie closer than mdp.control_period_ms: take another [curate] construction, "
            "or a larger ingest.grid_ms."
        )
    return "Check the units in [signals], and mdp.voltage_limit_v against the logged voltage."


def listing(reason: pd.Series) -> str:
    """How many rows have each reason, the most frequent first."""
    return ", ".join(f"{code}: {n}" for code, n in reason[reason != ""].value_counts().items())
