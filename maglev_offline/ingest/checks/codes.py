"""Every finding that the checks can make: its stable code, what it is about, and its words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from maglev_offline.ingest.findings import MOST_PLACES, Finding, Place, Severity

Numbers = Mapping[str, float | int | str]
"""Names tell how the numbers of two windows are joined, see `merge`."""


@dataclass(frozen=True)
class Code:
    """`about` and `severity` as in `Finding`; `sentence` explains the code; `what` is filled with the numbers."""

    about: Literal["recording", "signal", "use"]
    severity: Severity
    sentence: str
    what: str
    todo: str


CODES: dict[str, Code] = {
    "not_decodable": Code(
        "recording", "error", "Payloads cannot be read.",
        "Messages that cannot be decoded: {count:,} ({share:.2%}).",
        "They are left out. Record with whole message definitions, or mend the sender.",
    ),
    "no_time": Code(
        "recording", "error", "Messages lack the time stamp that the recipe's clock reads.",
        "Messages without a time by the chosen clock: {count:,} ({share:.2%}).",
        'They are left out. Use clock = "publish_time" or "log_time", or name another clock_field.',
    ),
    "repeated_messages": Code(
        "recording", "info", "Messages come twice: same time, same values.",
        "Messages that come again: {count:,}.",
        "Repeats are left out; nothing is lost. Look for two writers of one topic if there are many.",
    ),
    "time_conflict": Code(
        "recording", "warning", "Messages have the time of an earlier one and other values.",
        "Messages with the time of an earlier one and other values: {count:,} ({share:.2%}).",
        "The first of each time is kept. Where several points share the topic, record each on a topic of its own; else "
        "mend the sender's clock, or use another clock.",
    ),
    "clock_frozen": Code(
        "recording", "error", "The clock stands while messages go on.",
        "The clock stands for up to {largest_messages:,} messages.",
        "Their times say nothing: use another clock, or leave the stretch out.",
    ),
    "clock_reset": Code(
        "recording", "warning", "The clock goes back by more than messages are reordered by.",
        "Times at which the clock goes back: {count:,}, at most by {largest_back_s:.4g} s.",
        "A segment ends there, so nothing is mixed. Set the clock before recording.",
    ),
    "out_of_order": Code(
        "recording", "warning", "Messages lie in the file before others that are older.",
        "Messages older than one before them in the file: {count:,}, at most by {largest_back_ms:.4g} ms.",
        "They are sorted by time. Nothing to do if reorder_ms is long enough.",
    ),
    "late_messages": Code(
        "recording", "warning", "Messages are recorded much later after their stamp than is usual.",
        "Messages recorded late: {count:,}, at most {largest_delay_ms:.4g} ms after their stamp; usual are "
        "{usual_delay_ms:.3g} ms.",
        'They are sorted in by their stamp where clock = "publish_time" or "header". Look at the load of the recorder.',
    ),
    "latency": Code(
        "recording", "warning", "Recording follows the stamp by a large part of the period.",
        "Recording follows the stamp by {usual_delay_ms:.4g} ms, {periods:.2g} periods.",
        'Use clock = "publish_time" or "header", which the delay does not touch.',
    ),
    "logged_before_published": Code(
        "recording", "warning", "Messages are recorded before they were sent: the clocks disagree.",
        "Messages recorded before their own stamp: {count:,}, at most by {largest_lead_ms:.4g} ms.",
        "Sender and recorder have different clocks: synchronise them, and do not mix their times.",
    ),
    "clock_drift": Code(
        "recording", "warning", "Two clocks of the log run apart.",
        "{clocks} run apart by {drift_ppm:+.3g} ppm ({largest_apart_ms:.3g} ms over the stretch looked at).",
        "Merge nothing by these times over long spans; synchronise the clocks (PTP, NTP).",
    ),
    "clock_jump": Code(
        "recording", "warning", "One clock of the log jumps against another.",
        "Jumps of {clocks} against each other: {count:,}, at most by {largest_jump_ms:.4g} ms.",
        "One of the clocks was set during the recording: use the other one.",
    ),
    "hole": Code(
        "recording", "warning", "A silence longer than is bridged, in which messages are missing.",
        "Silences over the {bridge_ms:g} ms that are bridged: {count:,}, the longest of {longest_s:.3g} s.",
        "Segments end there, so no transition leads across. Look at the recorder if there are many.",
    ),
    "pause": Code(
        "recording", "info", "A silence longer than is bridged, in which the sequence numbers miss nothing.",
        "Silences in which the sequence numbers miss nothing: {count:,}, the longest of {longest_s:.3g} s.",
        "Segments end there. Nothing to do if the sender paused on purpose.",
    ),
    "dropped_messages": Code(
        "recording", "warning", "Single messages, or a few in a row, are missing.",
        "Messages missing by the {by}: {missing:,} ({share:.2%}), in {count:,} gaps.",
        "Silences up to longest_bridge_ms are interpolated across, and marked so. Look at queue sizes and the network.",
    ),
    "jitter": Code(
        "recording", "info", "The stamps jitter about their period.",
        "The steps between messages scatter by {jitter_ms:.3g} ms about {period_ms:.4g} ms ({share_jitter:.1%}).",
        "Rows are interpolated to the grid. Stamp where the sensor samples if it is much.",
    ),
    "rate_not_declared": Code(
        "recording", "warning", "The messages come at another rate than declared.",
        "Messages come every {period_ms:.4g} ms; declared are {declared_ms:.4g} ms.",
        "Correct declared_period_ms, or find out why the sender is off its rate.",
    ),
    "slower_than_grid": Code(
        "recording", "warning", "The messages come more slowly than the rows that are made of them.",
        "Messages come every {period_ms:.4g} ms, and rows are made every {grid_ms:.4g} ms.",
        "The rows between are interpolations: use grid_ms = {period_ms:.4g} or more.",
    ),
    "faster_than_grid": Code(
        "recording", "info", "The messages come faster than the rows that are made of them.",
        "Messages come every {period_ms:.4g} ms, and rows are made every {grid_ms:.4g} ms.",
        "A smaller grid_ms would use more of the log.",
    ),
    "seam": Code(
        "recording", "warning", "Several things jump at one place: the file was put together of several recordings.",
        "Places of the file at which several things jump: {count:,} ({signs}).",
        "Split the file there, so that the parts can be held apart when data are split for evaluation.",
    ),
    "not_finite": Code(
        "signal", "warning", "A signal is missing, NaN or infinite.",
        "Messages without a finite value of {signal}: {count:,} ({share:.2%}).",
        "They are left out. Find out when the sensor gives none.",
    ),
    "out_of_valid_range": Code(
        "signal", "warning", "A signal leaves the range that the recipe declares valid.",
        "Messages with {signal} outside its valid range: {count:,} ({share:.2%}).",
        "They are left out. Check `valid`, the unit and the sensor.",
    ),
    "stuck": Code(
        "signal", "error", "A signal keeps one value over a long stretch while others move.",
        "{signal} keeps one value for up to {longest_messages:,} messages ({longest_s:.3g} s) while {moving} moves.",
        "Leave the stretch out, and look at the sensor.",
    ),
    "quantised": Code(
        "signal", "warning", "The steps in which a signal is recorded are coarse.",
        "{signal} comes in steps of {quantum:.3g} {unit} ({share_of_operation:.2%} of its operating value, "
        "{share_of_spread:.2%} of its spread).",
        "Estimate no derivative of it without a filter; record with more bits or a smaller range.",
    ),
    "saturated": Code(
        "signal", "warning", "Many values lie at one extreme.",
        "{signal} is at its extreme of {extreme:.5g} {unit} in {messages:,} messages ({share:.2%}; runs: {count:,}).",
        "The extreme is a limit of the actuator or of the sensor: set voltage_limit_v by it, or widen the range.",
    ),
    "spikes": Code(
        "signal", "warning", "Single values jump away and back.",
        "Single values of {signal} off both neighbours: {count:,}, at most by {largest_jump:.3g} {unit}.",
        "Give the signal a `valid` range, and look at its cable and its sender.",
    ),
    "gap_below_zero": Code(
        "signal", "error", "The gap is negative, which cannot be.",
        "The gap is below 0 in {messages:,} messages ({share:.2%}), at the least {smallest:.4g} m.",
        "Correct the signal's offset or sign in [signals].",
    ),
    "gap_beyond_stop": Code(
        "signal", "warning", "The gap is greater than the lower stop allows.",
        "The gap is over the stop at {stop_m:.4g} m in {messages:,} messages ({share:.2%}), at most {largest:.4g} m.",
        "Correct gap_max_m in [plant], or the signal's offset or unit in [signals].",
    ),
    "current_below_zero": Code(
        "signal", "warning", "The current is negative, which a chopper of one sign cannot do.",
        "The current is below 0 in {messages:,} messages ({share:.2%}), at the least {smallest:.4g} A.",
        "Correct the signal's offset or sign in [signals].",
    ),
    "unit_suspect": Code(
        "signal", "error", "Typical values are far off the plant's: the declared unit looks wrong.",
        "{signal} is typically {typical:.3g} {unit}, {factor:.3g} times the plant's {expected:.3g} {unit}, "
        "with {declared!r} as its declared unit.",
        "The unit that would fit is {suggested!r}: correct it in [signals], or correct [plant].",
    ),
    "voltage_mismatch": Code(
        "use", "warning", "The voltage is not what R i + d(L i)/dt of the declared plant asks for.",
        "The voltage asks for {resistance_ohm:.4g} ohm ({low_ohm:.4g} to {high_ohm:.4g}); declared are "
        "{declared_ohm:.4g} ohm, which explain {share_explained:.1%} of it.",
        "Measure the coil, or look whether the signal is a command in other units; `identify` fits the plant.",
    ),
    "contact": Code(
        "use", "info", "The magnet touches a mechanical stop.",
        "The magnet is at a stop in {share:.2%} of the rows (runs: {count:,}).",
        "Rows in contact are left out, and segments end there. Check gap_min_m and gap_max_m if it cannot be.",
    ),
    "coarse_time_base": Code(
        "use", "warning", "Between two rows the fast modes turn too far.",
        "For each row of {grid_ms:g} ms the plant's fastest mode turns by {phase_plant_rad:.3g} rad and the strongest "
        "swing seen by {phase_seen_rad:.3g} rad.",
        "A row is no transition of one action. Record every {needed_ms:.2g} ms or faster.",
    ),
    "action_variance": Code(
        "use", "info", "How much of the action's variance the state leaves: a feedback law leaves little.",
        "The state leaves {share_left:.1%} of the voltage's variance (by a quadratic function of it).",
        "Where little is left, the log cannot tell what another action would have done: explore while recording.",
    ),
}  # fmt: skip


def make(
    code: str,
    log: str,
    topic: str,
    point: str,
    numbers: Numbers,
    *,
    places: Sequence[Place] = (),
    count: int | None = None,
    severity: Severity | None = None,
) -> Finding:
    """A finding of that code; `count` is that of the places if not given, and at least 1."""
    entry = CODES[code]
    number = max(len(places), 1) if count is None else count
    return Finding(
        code=code,
        severity=severity or entry.severity,
        about=entry.about,
        log=log,
        topic=topic,
        point=point,
        what=entry.what.format(count=number, **numbers),
        todo=entry.todo.format(count=number, **numbers),
        numbers=numbers,
        count=number,
        places=tuple(places[:MOST_PLACES]),
    )
