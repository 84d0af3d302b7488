"""How a look at a log reads to a person."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from maglev_offline.ingest.findings import Finding, Place
from maglev_offline.ingest.inspect import LogSummary

CHANNEL_COLUMNS = ("topic", "encoding", "schema", "messages", "period (ms)", "jitter (ms)", "longest silence (ms)")


def heading(log: LogSummary) -> str:
    """One line: the file, its size and hash, and whether it is simulated."""
    origin = "SIMULATED" if log.simulated else "not marked as simulated"
    packed = ", ".join(log.compressions) or "no chunks"
    return f"{log.file}: {log.size_bytes / 1e6:.2f} MB, {packed}, sha256 {log.sha256[:8]}, {origin}"


def channel_rows(log: LogSummary) -> list[list[str]]:
    """One row of `CHANNEL_COLUMNS` for each channel."""
    return [
        [
            channel.topic,
            channel.message_encoding + ("" if channel.decodable else " (no decoder)"),
            channel.schema_name,
            f"{channel.messages:,}",
            _ms(channel.period_ms),
            _ms(channel.jitter_ms),
            _ms(channel.longest_silence_ms),
        ]
        for channel in log.channels
    ]


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def remarks(log: LogSummary) -> list[str]:
    """What the log would be used for: the signals that were found, or why there are none."""
    if log.signals is None:
        return [f"  signals: {log.why_no_signals}"]
    found = {name: part for name, part in log.signals.items() if isinstance(part, dict) and "field" in part}
    found |= log.signals.get("context", {})
    lines = [
        "  signals: " + ", ".join(f"{name} = {part['field']} ({part['unit']})" for name, part in found.items()),
        f"  points: {', '.join(log.points)}",
    ]
    lines += [f"  left out: {point}, {why}" for point, why in log.points_left_out.items()]
    return lines


def plain_finding(finding: Finding) -> dict[str, Any]:
    """A finding for scripts. JSON has no infinite numbers, and what a log holds may overflow: they become null."""
    plain = finding.plain()
    numbers = plain["numbers"].items()
    plain["numbers"] = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in numbers}
    return plain


_MOST_PLACES = 3
"""So many places of a finding are printed; JSON and the page have more."""


def finding_lines(findings: Sequence[Finding]) -> list[str]:
    """Findings of one code in two lines or three: the one with the most places, and how many topics have it too."""
    groups: dict[tuple[str, str, str], list[Finding]] = {}
    for one in findings:
        groups.setdefault((one.severity, one.code, str(one.numbers.get("signal", ""))), []).append(one)
    lines = []
    for (severity, code, _), alike in groups.items():
        one = max(alike, key=lambda finding: finding.count)
        about = " ".join(filter(None, (one.point and f"point {one.point}", one.topic)))
        others = f", and {len(alike) - 1:,} more like it" if len(alike) > 1 else ""
        lines.append(f"  {severity}: {code}{f' ({about}{others})' if about else ''}: {one.what}")
        places = list(filter(None, map(_place, one.places[:_MOST_PLACES])))
        if places:
            more = f", and {one.count - len(places):,} more" if one.count > len(places) else ""
            lines.append(f"    at {'; '.join(places)}{more}")
        if one.todo:
            lines.append(f"    {one.todo}")
    return lines


def _place(place: Place) -> str:
    parts = []
    if place.start_ns is not None:
        parts.append(_time(place.start_ns))
        if place.end_ns is not None and place.end_ns != place.start_ns:
            parts.append(f"to {_time(place.end_ns)}")
    if place.first_message is not None:
        last = place.last_message
        parts.append(
            f"message {place.first_message:,}" + (f"-{last:,}" if last not in (None, place.first_message) else "")
        )
    if place.byte_offset is not None:
        parts.append(f"byte {place.byte_offset:,}")
    return " ".join(parts)


def _time(t_ns: int) -> str:
    seconds, below = divmod(t_ns, 10**9)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{below // 10**6:03d}Z"
