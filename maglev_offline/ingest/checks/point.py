"""What limits the use of a suspension point's samples."""

import numpy as np
from numpy.typing import NDArray

from maglev_offline.ingest.checks.codes import make
from maglev_offline.ingest.checks.settings import CheckSettings
from maglev_offline.ingest.checks.spectrum import fastest_rad_s, strongest_swing
from maglev_offline.ingest.checks.voltage import resistance_of_windows
from maglev_offline.ingest.contact import CONTACT
from maglev_offline.ingest.findings import Finding, Place, Severity
from maglev_offline.ingest.points import PointSamples
from maglev_offline.physics.parameters import Plant

Array = NDArray[np.float64]
Name = tuple[str, str, str]

_SOME_ROWS = 1000


# A log may hold any number: what overflows is out of every range, and is told or passed over as such.
@np.errstate(all="ignore")
def point_findings(log: str, samples: PointSamples, plant: Plant, settings: CheckSettings) -> list[Finding]:
    """Findings about one point: voltage against the coil's equation, contact, time base and action variance."""
    name = (log, "", samples.point)
    if len(samples.t_ns) < 2:
        return _contact(name, samples, settings)
    inside = samples.segment[1:] == samples.segment[:-1]
    steps = np.diff(samples.t_ns)[inside]
    if len(steps) == 0:
        return _contact(name, samples, settings)
    period_s = float(steps[0]) / 1e9  # rows are on a grid
    return [
        *_voltage(name, samples, plant, period_s, settings),
        *_contact(name, samples, settings),
        *_time_base(name, samples, plant, period_s, settings),
        *_action_variance(name, samples, settings),
    ]


def _span(samples: PointSamples) -> list[Place]:
    return [Place(int(samples.t_ns.min()), int(samples.t_ns.max()))]


def _voltage(
    name: Name, samples: PointSamples, plant: Plant, period_s: float, settings: CheckSettings
) -> list[Finding]:
    asked = resistance_of_windows(samples, plant, period_s, settings)
    declared = plant.resistance_ohm
    if asked is None or asked.low_ohm <= declared <= asked.high_ohm:
        return []
    if abs(asked.resistance_ohm / declared - 1) <= settings.resistance_tolerance:
        return []
    numbers = {
        "resistance_ohm": asked.resistance_ohm,
        "low_ohm": asked.low_ohm,
        "high_ohm": asked.high_ohm,
        "declared_ohm": declared,
        "share_explained": asked.share_explained,
        "windows": asked.windows,
        "of": len(samples.t_ns),
    }
    return [make("voltage_mismatch", *name, numbers, places=_span(samples))]


def _contact(name: Name, samples: PointSamples, settings: CheckSettings) -> list[Finding]:
    """Runs of rows at a stop: those put aside, and the first of each run, which ends its segment."""
    aside = [entry.t_ns for entry in samples.entries if entry.code == CONTACT]
    t_ns = np.concatenate([*aside, samples.t_ns[samples.contact]])
    if len(t_ns) == 0:
        return []
    t_ns = np.sort(t_ns)
    step = np.diff(t_ns)
    # Rows of one run are one period apart; where all runs are single rows, none is shorter than the grid's step.
    inside = np.diff(samples.t_ns)[samples.segment[1:] == samples.segment[:-1]]
    period = int(inside.min()) if len(inside) else (int(step.min()) if len(step) else 0)
    first = np.concatenate([[0], np.flatnonzero(step > 1.5 * period) + 1])
    last = np.concatenate([first[1:] - 1, [len(t_ns) - 1]])
    share = len(t_ns) / max(samples.grid_rows, 1)
    numbers = {"share": share, "messages": len(t_ns), "of": samples.grid_rows}
    places = [Place(int(t_ns[a]), int(t_ns[b])) for a, b in zip(first.tolist(), last.tolist(), strict=True)]
    severity: Severity | None = "warning" if share > settings.contact_share else None
    return [make("contact", *name, numbers, places=places, count=len(first), severity=severity)]


def _time_base(
    name: Name, samples: PointSamples, plant: Plant, period_s: float, settings: CheckSettings
) -> list[Finding]:
    fastest = fastest_rad_s(plant)
    seen = strongest_swing(samples.values["gap_m"], samples.segment)
    phase = max(fastest * period_s, seen)
    if phase <= settings.largest_phase_rad:
        return []
    numbers = {
        "grid_ms": period_s * 1e3,
        "phase_plant_rad": fastest * period_s,
        "phase_seen_rad": seen,
        "fastest_rad_s": fastest,
        "needed_ms": period_s * 1e3 * settings.largest_phase_rad / phase,
        "of": len(samples.t_ns),
    }
    return [make("coarse_time_base", *name, numbers, places=_span(samples))]


def _action_variance(name: Name, samples: PointSamples, settings: CheckSettings) -> list[Finding]:
    """Share of the voltage's variance that no quadratic function of the state explains."""
    every = max(len(samples.t_ns) // _SOME_ROWS, 1)
    names = ("voltage_v", "gap_m", "gap_velocity_m_s", "current_a", "set_point_m")
    rows = np.stack([samples.values[name][::every] for name in names])
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    if rows.shape[1] < 50:
        return []
    voltage, *state = rows
    z = [(column - column.mean()) / column.std() for column in state if _moves(column)]
    basis = np.stack([np.ones(len(voltage)), *z, *(z[a] * z[b] for a in range(len(z)) for b in range(a, len(z)))])
    action = voltage - voltage.mean()
    power = float(action @ action)
    if power == 0:
        return []
    # The normal equations of scaled columns; a touch of a ridge keeps columns that hardly move from spoiling them.
    gram = basis @ basis.T + 1e-9 * len(action) * np.eye(len(basis))
    left = action - np.linalg.solve(gram, basis @ action) @ basis
    share = float(left @ left) / power
    low = share < settings.smallest_action_variance
    numbers = {"share_left": share, "of": len(samples.t_ns)}
    severity: Severity | None = "warning" if low else None
    return [make("action_variance", *name, numbers, places=_span(samples), severity=severity)]


def _moves(values: Array) -> bool:
    return float(np.ptp(values)) > 1e-9 * float(np.abs(values).max())
