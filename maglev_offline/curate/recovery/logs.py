"""Recovery of whole logs: the law of each log, then all of its chains."""

from typing import Any, NamedTuple, cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.between import Periods, joined_periods
from maglev_offline.curate.recovery.groups import Wanted, recover_all, surprises
from maglev_offline.curate.recovery.model import Model
from maglev_offline.curate.recovery.recover import ITERATIONS, Recovery
from maglev_offline.curate.recovery.settings import LawName, RecoverySettings
from maglev_offline.curate.recovery.tracks import Tracks, tracks_of
from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant

TRIED_CHAINS, TRIED_SAMPLES, TRIED_ITERATIONS = 12, 15, 2
"""A law is chosen by so many chains of a log, the first samples of each: the start of a run moves most."""

LEAST_GAIN = 6.0
"""By so much a law must raise the log-likelihood of a sample, twice and in the mean, above no law at all: a law that
did not act fits a little better than none by chance, and then shapes all that lies between the samples."""

MOST_SURPRISE = 100.0
"""A sample counts no more than this for or against a law: one that meets a stop between samples is nobody's fault."""


class LogRecovery(NamedTuple):
    """Logs (samples of one period) that one law was taken for, and what was found in them and between their samples."""

    log_ids: tuple[str, ...]
    law: LawName
    recovery: Recovery
    periods: Periods


class Recovered(NamedTuple):
    """Every recovered control period, by ascending `periods.sample`, and whether the plant explains it [m]."""

    logs: list[LogRecovery]
    periods: Periods
    explained: NDArray[np.bool_]


def recover_logs(
    samples: pd.DataFrame, plant: Plant, mdp: Mdp, belief: Belief | None = None, jobs: int = 1
) -> Recovered:
    """Recover all samples of a table that is in the order of `Pairs.samples`; `jobs` groups of chains at once."""
    logs = recover_parts(samples, plant, mdp, belief or Belief(), jobs=jobs)
    periods, explained = [], []
    for one in logs:
        mine = one.periods
        tracks = one.recovery.tracks
        fine = np.zeros(len(samples), dtype=bool)
        fine[tracks.row[tracks.inner]] = one.recovery.trusted
        periods.append(mine)
        explained.append(fine[mine.sample])
    if not periods:
        empty, none, no_rows = np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
        return Recovered([], Periods(no_rows, no_rows, none, none, none, none, empty, empty), np.zeros(0, dtype=bool))
    joined = joined_periods(periods)
    order = np.argsort(joined.sample, kind="stable")
    in_order = Periods(*(cast(Any, field[order]) for field in joined))
    return Recovered(logs, in_order, np.concatenate(explained)[order])


def recover_parts(
    samples: pd.DataFrame,
    plant: Plant,
    mdp: Mdp,
    belief: Belief,
    most_chains: int | None = None,
    most: int | None = None,
    iterations: int = ITERATIONS,
    jobs: int = 1,
) -> list[LogRecovery]:
    """Recover the chains of each log (`most_chains` of them, spread evenly, `most` samples in the middle of each)."""
    found: list[tuple[tuple[str, ...], LawName]] = []
    wanted: list[Wanted] = []
    for tracks in tracks_of(samples):
        log_of_chain = samples["log_id"].to_numpy()[tracks.row[tracks.start]]
        logs = pd.unique(log_of_chain)
        chains = {log: some_of(np.flatnonzero(log_of_chain == log), most_chains) for log in logs}
        line = _line_std(tracks, belief.settings)
        settings = belief.settings
        names: tuple[LawName, ...] = ("pid", "cascade", "none") if settings.law == "auto" else (settings.law,)
        models = {law: Model(plant, mdp, settings, belief.gain(plant, law), tracks.period_s, line) for law in names}
        law_of = _choices(tracks, chains, models, jobs)
        for law, model in models.items():
            mine = [log for log in logs if law_of[log] == law]
            if mine:
                part = tracks.part(np.sort(np.concatenate([chains[log] for log in mine])), most, middle=True)
                found.append((tuple(map(str, mine)), law))
                wanted.append(Wanted(model, part, iterations))
    return [LogRecovery(*which, *one) for which, one in zip(found, recover_all(wanted, jobs), strict=True)]


def some_of(chains: NDArray[np.int64], most: int | None) -> NDArray[np.int64]:
    """At most so many of the chains, spread evenly."""
    if most is None or len(chains) <= most:
        return chains
    return chains[np.linspace(0, len(chains) - 1, most).round().astype(np.int64)]


def _choices(
    tracks: Tracks, chains: dict[str, NDArray[np.int64]], models: dict[LawName, Model], jobs: int
) -> dict[str, LawName]:
    """For each log the law that foretells its samples best, in the mean log-likelihood of a sample, or none."""
    names = list(models)
    if len(names) == 1:
        return dict.fromkeys(chains, names[0])
    tried = {log: some_of(mine, TRIED_CHAINS) for log, mine in chains.items()}
    together = np.sort(np.concatenate(list(tried.values())))
    part = tracks.part(together, TRIED_SAMPLES)
    surprise = np.empty((len(names), len(part.start)))
    wanted = [Wanted(model, part, TRIED_ITERATIONS) for model in models.values()]
    for k, (name, each) in enumerate(zip(names, surprises(wanted, jobs), strict=True)):
        each = np.where(np.isfinite(each), np.clip(each, -MOST_SURPRISE, MOST_SURPRISE), MOST_SURPRISE)
        surprise[k] = np.bincount(part.chain, weights=each + LEAST_GAIN * (name != "none"))
    place = {log: np.searchsorted(together, mine) for log, mine in tried.items()}
    return {log: names[int(np.argmin(surprise[:, at].sum(axis=1)))] for log, at in place.items()}


def _line_std(tracks: Tracks, settings: RecoverySettings) -> float:
    """How far the voltage is from the line: as told, or as samples are from the line of their neighbours."""
    if settings.voltage_line_std_v is not None:
        return settings.voltage_line_std_v
    voltage, chain = tracks.value[:, 3], tracks.chain
    inside = chain[2:] == chain[:-2]
    off = (voltage[1:-1] - (voltage[2:] + voltage[:-2]) / 2)[inside]
    return max(float(np.sqrt(np.mean(off**2))) if len(off) else 0.0, settings.voltage_std_v)
