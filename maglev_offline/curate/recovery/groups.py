"""Recovery by groups of chains, which know nothing of each other: side by side, and the same bits as all at once."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from maglev_offline.curate.recovery.between import Periods, joined_periods, periods_of
from maglev_offline.curate.recovery.model import Model
from maglev_offline.curate.recovery.recover import Recovery, drive_of, recover
from maglev_offline.curate.recovery.smoother import Smoothed
from maglev_offline.curate.recovery.tracks import Tracks
from maglev_offline.spread import spread

Made = TypeVar("Made")

SAMPLES = 8192
"""A group ends with the chain in which it reaches so many samples: some seconds of work, and some MB of results."""


class Wanted(NamedTuple):
    """Chains to recover with one model, the motion linearised so many times."""

    model: Model
    tracks: Tracks
    iterations: int


def recover_all(wanted: Sequence[Wanted], jobs: int = 1) -> list[tuple[Recovery, Periods]]:
    """Recover each, and the control periods within its intervals."""
    groups = [list(groups_of(one)) for one in wanted]
    done = _each(_recovered, groups, jobs)
    return [
        _joined(one, [next(done) for _ in some]) if some else _recovered(one)
        for one, some in zip(wanted, groups, strict=True)
    ]


def surprises(wanted: Sequence[Wanted], jobs: int = 1) -> list[NDArray[np.float64]]:
    """The surprise of each sample of each; see `Smoothed`."""
    groups = [list(groups_of(one)) for one in wanted]
    done = _each(_surprise, groups, jobs)
    return [np.concatenate([np.zeros(0), *(next(done) for _ in some)]) for some in groups]


def groups_of(wanted: Wanted, most: int = SAMPLES) -> Iterator[Wanted]:
    """Groups of whole chains, one after the other; what they are depends on the chains alone."""
    tracks = wanted.tracks
    begin = tracks.start
    of_chain = (begin + tracks.length - 1) // most
    for number in np.unique(of_chain):
        yield wanted._replace(tracks=tracks.part(np.flatnonzero(of_chain == number).astype(np.int64)))


def _each(do: Callable[[Wanted], Made], groups: Sequence[Sequence[Wanted]], jobs: int) -> Iterator[Made]:
    """In their order; what takes less time than to start a process is done in this one."""
    every = [group for some in groups for group in some]
    if len(every) < 2 or sum(len(group.tracks) for group in every) <= 2 * SAMPLES:
        return (do(group) for group in every)
    return spread(do, ((group,) for group in every), min(jobs, len(every)))


def _recovered(wanted: Wanted) -> tuple[Recovery, Periods]:
    found = recover(*wanted)
    return found, periods_of(found)


def _surprise(wanted: Wanted) -> NDArray[np.float64]:
    return recover(*wanted).found.surprise


def _joined(wanted: Wanted, parts: Sequence[tuple[Recovery, Periods]]) -> tuple[Recovery, Periods]:
    """Chains, their samples and their intervals are all in one order, and so are the groups."""
    if len(parts) == 1:
        return parts[0]
    model, tracks, _ = wanted
    recoveries = [recovery for recovery, _ in parts]

    def one_after_the_other(name: str) -> NDArray[np.float64]:
        return np.concatenate([getattr(recovery, name) for recovery in recoveries])

    found = Smoothed(*(np.concatenate(field) for field in zip(*(one.found for one in recoveries), strict=True)))
    joined = Recovery(
        model=model,
        tracks=tracks,
        drive=drive_of(tracks),
        about=one_after_the_other("about"),
        found=found,
        explained=cast(NDArray[np.bool_], one_after_the_other("explained")),
        nis_share=one_after_the_other("nis_share"),
        surprising=cast(NDArray[np.bool_], one_after_the_other("surprising")),
        lost=cast(NDArray[np.bool_], one_after_the_other("lost")),
    )
    return joined, joined_periods([periods for _, periods in parts])
