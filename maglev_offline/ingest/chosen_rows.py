"""The rows of a suspension point that fulfil the conditions of `[select]`."""

from dataclasses import replace

import numpy as np

from maglev_offline.ingest import ledger
from maglev_offline.ingest.ledger import Quarantined
from maglev_offline.ingest.points import LONE_SAMPLE, PointSamples
from maglev_offline.ingest.select import Selection, cut_segments, rows_mask


def choose_rows(samples: PointSamples, topic: str, selection: Selection) -> PointSamples:
    """Put aside the rows that fail a condition; where a row goes, its segment ends. `topic` is that of the gap.

    Raises
    ------
    InputError: a condition speaks of a column that the samples do not have.
    """
    if not selection.where:
        return samples
    chosen = rows_mask({**samples.values, "contact": samples.contact}, selection)
    entries: list[Quarantined] = []
    keep = chosen.keep
    entries.append(ledger.rows(samples.point, topic, chosen.code, samples.t_ns[~keep], chosen.detail))
    segment, step = cut_segments(samples.segment, samples.step, keep)
    if len(segment):
        lone = np.bincount(segment)[segment] == 1
        at = np.flatnonzero(keep)
        entries.append(ledger.rows(samples.point, topic, LONE_SAMPLE, samples.t_ns[at[lone]], "after a selection"))
        keep = keep.copy()
        keep[at[lone]] = False
        segment, step = cut_segments(samples.segment, samples.step, keep)
    return replace(
        samples,
        t_ns=samples.t_ns[keep],
        segment=segment,
        step=step,
        values={name: column[keep] for name, column in samples.values.items()},
        origins={name: column[keep] for name, column in samples.origins.items()},
        contact=samples.contact[keep],
        entries=[*samples.entries, *entries],
    )
