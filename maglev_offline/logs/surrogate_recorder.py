"""The recorder of the surrogate logs: noisy sensors, jittered stamps, and faults planted at known places."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maglev_offline.logs.surrogate_defects import places, plant_in_messages, plant_in_stamps
from maglev_offline.logs.surrogate_plant import RunTruth
from maglev_offline.logs.surrogate_record import MS, Record
from maglev_offline.logs.surrogate_settings import SurrogateSettings
from maglev_offline.logs.writer import Messages, MessageType
from maglev_offline.streams import stream

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STATE_MESSAGE = MessageType(
    "maglev/msg/SuspensionState",
    {
        "gap_mm": "mm",
        "gap_velocity_mm_s": "mm/s",
        "coil_current_a": "A",
        "coil_voltage_v": "V",
        "set_point_mm": "mm",
        "speed_km_h": "km/h",
        "load_kg": "kg",
        "chainage_m": "m",
    },
)


@dataclass
class Defects:
    """What was planted, in the log's own stamps: messages by topic and sequence, stretches by true time.

    `planted`: those of `[surrogate.defects]`, each with its settings and places. They are planted after the recorder's
    faults, which are told as they were before: a seam or a changed clock moves them.
    """

    late: list[dict[str, Any]] = field(default_factory=list)
    dropped: list[dict[str, Any]] = field(default_factory=list)
    repeated: list[dict[str, Any]] = field(default_factory=list)
    holes: list[dict[str, Any]] = field(default_factory=list)
    clock_reset: dict[str, Any] | None = None
    runs: list[dict[str, Any]] = field(default_factory=list)
    planted: list[dict[str, Any]] = field(default_factory=list)


@dataclass(frozen=True)
class Batch:
    """Messages of one topic in one run: sensor time and arrival in true ns of the log, sequence, values [n, fields]."""

    topic: int
    taken_ns: Index
    arrived_ns: Index
    sequence: Index
    values: Array


def topic_of(point: int) -> str:
    """Topic of a suspension point, counted from 0 here and from 1 in the name."""
    return f"/suspension/P{point + 1}/state"


def record(
    truths: list[RunTruth], settings: SurrogateSettings, log: int, load_kg: float, epoch_ns: int
) -> tuple[Messages, Defects]:
    """Record the runs of a log: messages in order of arrival, and the list of what is wrong with them."""
    defects = Defects()
    holes = _holes(settings, log, epoch_ns, defects)
    reset = _clock_reset(settings, log, epoch_ns, defects)
    batches = []
    next_sequence = np.zeros(settings.points, dtype=np.int64)
    for number, truth in enumerate(truths):
        start_ns = epoch_ns + round(truth.run.start_s * 1e3) * MS
        defects.runs.append({"start_ns": start_ns, "end_ns": start_ns + truth.run.steps * MS})
        for point in range(settings.points):
            batch = _sensor_messages(truth, settings, log, number, point, load_kg, int(next_sequence[point]), start_ns)
            next_sequence[point] += len(batch.sequence)
            batches.append(_plant_faults(batch, settings, f"{log}/{number}/{point}", holes, reset, defects))
    topic = np.concatenate([np.full(len(b.sequence), b.topic) for b in batches])
    taken, arrived, sequence = (
        np.concatenate([getattr(b, name) for b in batches]) for name in ("taken_ns", "arrived_ns", "sequence")
    )
    values = np.concatenate([b.values for b in batches])
    columns = {name: k for k, name in enumerate(STATE_MESSAGE.units)}
    made = Record(topic, arrived, taken, sequence, values, np.arange(len(topic)), columns).in_order()
    made = _plant_defects(made, settings, log, epoch_ns, reset, defects)
    return Messages(made.topic, made.arrived_ns, made.taken_ns, made.sequence, made.values), defects


def _plant_defects(
    record: Record, settings: SurrogateSettings, log: int, epoch_ns: int, clock: "_Clock", defects: Defects
) -> Record:
    """Plant the defects of `[surrogate.defects]`, give the messages the log's stamps, and write down the places."""
    record, in_messages = plant_in_messages(record, settings.defects, settings.seed, log, epoch_ns)
    stamped = replace(record, arrived_ns=clock.stamp(record.arrived_ns), taken_ns=clock.stamp(record.taken_ns))
    stamped, in_stamps = plant_in_stamps(record, stamped, settings.defects, log, epoch_ns)
    topics = [topic_of(point) for point in range(settings.points)]
    defects.planted = places(in_messages + in_stamps, stamped, topics)
    return stamped


@dataclass(frozen=True)
class _Clock:
    """The log's clock: true time until `at_ns`, then `back_ns` behind it."""

    at_ns: int
    back_ns: int

    def stamp(self, true_ns: Index) -> Index:
        return np.where(true_ns >= self.at_ns, true_ns - self.back_ns, true_ns)


def _clock_reset(settings: SurrogateSettings, log: int, epoch_ns: int, defects: Defects) -> _Clock:
    faults = settings.recorder
    if faults.clock_reset_log != log or faults.clock_reset_at_s >= settings.duration_s:
        return _Clock(np.iinfo(np.int64).max, 0)
    clock = _Clock(epoch_ns + round(faults.clock_reset_at_s * 1e3) * MS, round(faults.clock_reset_back_s * 1e3) * MS)
    defects.clock_reset = {"true_time_ns": clock.at_ns, "back_ns": clock.back_ns}
    return clock


def _holes(settings: SurrogateSettings, log: int, epoch_ns: int, defects: Defects) -> list[tuple[int, int]]:
    rng, now = stream(settings.seed, f"surrogate/{log}/holes"), 0.0
    holes: list[tuple[int, int]] = []
    while True:
        now += rng.uniform(0.5, 1.5) * settings.recorder.hole_spacing_s
        if now >= settings.duration_s:
            return holes
        length = rng.uniform(*settings.recorder.hole_s)
        start = epoch_ns + round(now * 1e3) * MS
        holes.append((start, start + round(length * 1e3) * MS))
        defects.holes.append({"start_ns": holes[-1][0], "end_ns": holes[-1][1]})


def _sensor_messages(
    truth: RunTruth,
    settings: SurrogateSettings,
    log: int,
    number: int,
    point: int,
    load_kg: float,
    first_sequence: int,
    start_ns: int,
) -> Batch:
    """What the point's sensors send in a run, before anything goes wrong with it."""
    rng = stream(settings.seed, f"surrogate/{log}/{number}/{point}/sensors")
    planned = truth.run.planned_steps // settings.message_period_ms
    noise = rng.normal(size=(planned, 4))
    jitter = np.rint(rng.normal(size=planned) * settings.recorder.jitter_std_ms).clip(-30, 30).astype(np.int64)
    latency_us = np.rint(rng.gamma(2.0, settings.recorder.latency_ms / 2, planned) * 1e3).astype(np.int64)
    phase = 40 + (17 * point) % 20  # points do not sample at the same instant; no jitter reaches out of the run
    at = np.arange(planned) * settings.message_period_ms + phase + jitter
    at = at[at < truth.run.steps]
    bias = stream(settings.seed, f"surrogate/{log}/{point}/bias").normal() * settings.sensors.velocity_bias_std_m_s
    values = _readings(truth, settings, at, point, noise[: len(at)], bias, load_kg)
    taken = start_ns + at * MS
    sequence = first_sequence + np.arange(len(at))
    return Batch(point, taken, taken + latency_us[: len(at)] * 1000, sequence, values)


def _readings(
    truth: RunTruth, settings: SurrogateSettings, at: Index, point: int, noise: Array, bias: float, load_kg: float
) -> Array:
    """Field values [n, 8] in the units of the message, with noise, and quantised to clean decimals."""
    s = settings.sensors
    here = (at, point)
    columns = (
        (1e3 * (truth.gap_m[here] + s.gap_std_m * noise[:, 0]), 1e3 * s.gap_quantum_m),
        (1e3 * (truth.velocity_m_s[here] + bias + s.velocity_std_m_s * noise[:, 1]), 1e3 * s.velocity_quantum_m_s),
        (truth.current_a[here] + s.current_std_a * noise[:, 2], s.current_quantum_a),
        (truth.voltage_v[here] + s.voltage_std_v * noise[:, 3], s.voltage_quantum_v),
        (1e3 * truth.set_point_m[here], 1e3 * s.gap_quantum_m),
        (3.6 * truth.speed_m_s[at], 0.1),
        (np.full(len(at), load_kg), 1e-4),
        (truth.chainage_m[here], 0.1),
    )
    return np.stack([np.round(np.rint(x / quantum) * quantum, 9) + 0.0 for x, quantum in columns], axis=-1)


def _plant_faults(
    batch: Batch,
    settings: SurrogateSettings,
    name: str,
    holes: list[tuple[int, int]],
    clock: _Clock,
    defects: Defects,
) -> Batch:
    """Delay, drop and repeat messages, cut the holes, and write all of it down."""
    faults = settings.recorder
    rng = stream(settings.seed, f"surrogate/{name}/faults")
    draws = rng.random((len(batch.sequence), 4))
    in_hole = np.zeros(len(batch.sequence), dtype=bool)
    for start, end in holes:
        in_hole |= (batch.taken_ns >= start) & (batch.taken_ns < end)
    dropped = draws[:, 0] < faults.dropped_share
    sent = ~in_hole & ~dropped
    late = (draws[:, 1] < faults.late_share) & sent
    repeated = (draws[:, 2] < faults.repeated_share) & sent & ~late
    delay_us = np.rint((faults.late_ms[0] + draws[:, 3] * (faults.late_ms[1] - faults.late_ms[0])) * 1e3)
    arrived = batch.arrived_ns + late * delay_us.astype(np.int64) * 1000
    for found, rows in ((defects.late, late), (defects.repeated, repeated), (defects.dropped, dropped & ~in_hole)):
        found.extend(
            {
                "topic": topic_of(batch.topic),
                "sequence": int(batch.sequence[k]),
                "publish_time_ns": int(clock.stamp(batch.taken_ns[k : k + 1])[0]),
                "log_time_ns": int(clock.stamp(arrived[k : k + 1])[0]),
            }
            for k in np.flatnonzero(rows)
        )
    rows = np.concatenate([np.flatnonzero(sent), np.flatnonzero(repeated)])
    again = np.arange(len(rows)) >= sent.sum()
    return Batch(
        batch.topic,
        batch.taken_ns[rows],
        arrived[rows] + again * MS,
        batch.sequence[rows],
        batch.values[rows],
    )
