"""What the recovery can and cannot know of these logs, in numbers; `recovery_words` has the words."""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from maglev_offline.control.feedback import closed_loop_poles
from maglev_offline.curate.recovery.belief import Belief
from maglev_offline.curate.recovery.between import Periods
from maglev_offline.curate.recovery.logs import LogRecovery, recover_parts, some_of
from maglev_offline.curate.recovery.model import Model
from maglev_offline.curate.recovery.tracks import ORIGINS, SIGNALS
from maglev_offline.curate.recovery.words import RecoveryVerdict
from maglev_offline.mdp import Mdp
from maglev_offline.physics.linear import linearise
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]

PILOT_LOGS, PILOT_CHAINS, PILOT_SAMPLES, PILOT_ITERATIONS = 12, 16, 20, 2
"""So much is recovered for the verdict alone: logs, chains of each, samples in the middle of each chain, iterations."""

TRUSTED, LIMITED = 0.9, 0.5
"""Least share of the variance of gap, velocity and current that has to be known, and of the samples that the plant
has to explain. 0.9 leaves an error of a third of the spread."""


def pilot(samples: pd.DataFrame, plant: Plant, mdp: Mdp, belief: Belief, jobs: int = 1) -> list[LogRecovery]:
    """Recover a small part of the logs; `samples` in the order of `Pairs.samples`."""
    logs = pd.unique(samples["log_id"])
    some = logs[some_of(np.arange(len(logs)), PILOT_LOGS)]
    part = samples[samples["log_id"].isin(some)].reset_index(drop=True)
    return recover_parts(part, plant, mdp, belief, PILOT_CHAINS, PILOT_SAMPLES, PILOT_ITERATIONS, jobs)


def recovery_facts(samples: pd.DataFrame, logs: list[LogRecovery]) -> dict[str, Any]:
    """Signals, law, phase, what is known, expected errors and the verdict, JSON-able.

    `phase_rad`: by how much the loop's fastest oscillation turns from sample to sample (pi is Nyquist's limit); where
    no law is known or its loop does not oscillate, the plant's unstable pole times the period, which any loop
    that holds it outruns (`phase_of`). It is the largest of any log; `phase_rad_by_law` has each.
    `explained_share`: of the intervals. `expected_std`: root mean variance of gap (m), velocity (m/s) and current (A)
    over all recovered control periods that the plant explains; `spread`: of the states at the samples, with that error;
    `known_share`: 1 - (std / spread)^2. Numbers are null where nothing was recovered.
    """
    phase, phase_of = _phase(logs)
    weight = sum(len(one.recovery.tracks) for one in logs)
    intervals = sum(len(one.recovery.trusted) for one in logs)
    explained = sum(int(one.recovery.trusted.sum()) for one in logs)
    std, spread = _errors([(one, one.periods) for one in logs])
    known = None if std is None or spread is None else [1 - (e / s) ** 2 for e, s in zip(std, spread, strict=True)]
    share = explained / intervals if intervals else 0.0
    signals = _signals(samples)
    lawless = any(one.law == "none" for one in logs)
    return {
        "verdict": _verdict(share, known, phase if lawless else 0.0, signals["velocity"] == "logged"),
        "signals": signals,
        "laws": {
            law: sum(len(one.log_ids) for one in logs if one.law == law) for law in sorted({one.law for one in logs})
        },
        "phase_rad": phase,
        "phase_of": phase_of,
        "phase_rad_by_law": {
            law: _phase([one for one in logs if one.law == law])[0] for law in sorted({one.law for one in logs})
        },
        "samples": weight,
        "explained_share": share,
        "expected_std": _named(std),
        "spread": _named(spread),
        "known_share": _named(known),
    }


def _verdict(share: float, known: list[float] | None, lawless_phase: float, velocity_logged: bool) -> RecoveryVerdict:
    """A voltage line says little where the loop turns by a right angle between samples, whatever the covariances."""
    if known is None or share < LIMITED or min(known) < LIMITED or (lawless_phase >= np.pi and not velocity_logged):
        return "not_identifiable"
    if share < TRUSTED or min(known) < TRUSTED or lawless_phase > np.pi / 2:
        return "limited"
    return "trustworthy"


def _phase(logs: list[LogRecovery]) -> tuple[float, str]:
    """The largest phase of any log, and what it is of."""
    found = [(0.0, "nothing")]
    for one in logs:
        model = one.recovery.model
        turning = float(np.abs(model.poles.imag).max()) if model.gain is not None else 0.0
        unstable = _unstable_pole(model)
        found.append((turning * model.period_s, "law") if turning > 0 else (unstable * model.period_s, "unstable pole"))
    return max(found)


def _unstable_pole(model: Model) -> float:
    return float(closed_loop_poles(linearise(model.plant), np.zeros(4)).real.max())


def _errors(parts: list[tuple[LogRecovery, Periods]]) -> tuple[list[float] | None, list[float] | None]:
    """Root mean variance [3] over the control periods of explained chains, and the spread of the states at their
    samples, that variance added."""
    states, variances = [], []
    for one, periods in parts:
        tracks, fine = one.recovery.tracks, one.recovery.explained
        finite = np.isfinite(periods.state).all(axis=1) & np.isfinite(periods.std).all(axis=1)
        explained = finite & np.repeat(one.recovery.trusted, len(periods.sample) // max(len(tracks.inner), 1))
        at_samples = one.recovery.about[fine[tracks.chain]][:, :3]  # bounded, whatever the covariances
        at_samples[:, 0] -= tracks.set_point_m[fine[tracks.chain]]
        states.append(at_samples)
        variances.append(periods.std[explained] ** 2)
    if not sum(len(variance) for variance in variances):
        return None, None
    variance = np.concatenate(variances).mean(axis=0)
    return np.sqrt(variance).tolist(), np.sqrt(np.concatenate(states).var(axis=0) + variance).tolist()


def _named(values: list[float] | None) -> dict[str, float] | None:
    return None if values is None else dict(zip(("gap", "velocity", "current"), map(float, values), strict=True))


def _signals(samples: pd.DataFrame) -> dict[str, str]:
    """Each signal as it is in most samples: logged, reconstructed (made from another signal), or absent."""
    found = {}
    for name, column, origin in zip(("gap", "velocity", "current", "voltage"), SIGNALS, ORIGINS, strict=True):
        there = samples[column].notna()
        made = (samples[origin] == "reconstructed") if origin in samples else pd.Series(False, index=samples.index)
        counts = {
            "absent": int((~there).sum()),
            "reconstructed": int((there & made).sum()),
            "logged": int((there & ~made).sum()),
        }
        found[name] = max(counts, key=lambda kind: counts[kind])
    return found
