"""What `inspect` found as one HTML page: no script, no network, every text escaped."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import jinja2

from maglev_offline import __version__
from maglev_offline.ingest.findings import SEVERITIES, Finding, Place
from maglev_offline.ingest.inspect_lanes import Lane, lanes_of, time_range

MOST_SHOWN = 5
"""So many places of a finding are written out."""

_LONGEST_VALUE = 200  # characters of a metadata value
_NO_BREAK = "\N{NO-BREAK SPACE}"
_NOTHING = "–"


@dataclass(frozen=True)
class Told:
    """A finding in words: `numbers` and `places` are text, `more` counts the places that are not written out."""

    finding: Finding
    numbers: Sequence[tuple[str, str]]
    places: Sequence[str]
    more: int


@dataclass(frozen=True)
class LogView:
    """One log as the page shows it; `findings` are grouped by severity, the worst first."""

    summary: Mapping[str, Any]
    channels: Sequence[Mapping[str, str]]
    signals: Sequence[tuple[str, str, str, str]]
    rules: Sequence[tuple[str, str]]
    facts: Sequence[tuple[str, str]]
    metadata: Sequence[tuple[str, str, str]]
    lanes: Sequence[Lane]
    span: tuple[str, str, str] | None
    findings: Sequence[tuple[str, Sequence[Told]]]
    counts: Mapping[str, int]


def inspect_page(summaries: Sequence[Mapping[str, Any]], findings: Sequence[Finding]) -> str:
    """Set the page of these logs, in the order given: `summaries` as of `LogSummary.as_dict`.

    A finding belongs to the log whose `file` it names, and stands at the end of the page if there is none.
    """
    files = {summary["file"] for summary in summaries}
    by_file: dict[str, list[Finding]] = {}
    for finding in findings:
        by_file.setdefault(finding.log if finding.log in files else "", []).append(finding)
    views = [_view(summary, by_file.get(summary["file"], [])) for summary in summaries]
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("maglev_offline.ingest"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_printable,
    )
    return environment.get_template("inspect.html.j2").render(
        logs=views,
        others=_grouped(by_file.get("", [])),
        counts=_counts(findings),
        severities=tuple(reversed(SEVERITIES)),
        version=__version__,
    )


# Controls are no text, marks of direction let a name look like another, and lone surrogates cannot be written.
_UNPRINTABLE = dict.fromkeys(
    (
        *range(9),
        11,
        12,
        *range(14, 32),
        *range(127, 160),
        0x200E,
        0x200F,
        *range(0x202A, 0x202F),
        *range(0x2066, 0x206A),
    ),
    "\N{REPLACEMENT CHARACTER}",
) | dict.fromkeys(range(0xD800, 0xE000), "\N{REPLACEMENT CHARACTER}")


def _printable(value: object) -> object:
    return value.translate(_UNPRINTABLE) if type(value) is str else value


def _view(summary: Mapping[str, Any], findings: Sequence[Finding]) -> LogView:
    span = time_range(summary["channels"])
    signals, rules = _signals(summary["signals"] or {})
    return LogView(
        summary=summary,
        channels=[_channel(channel) for channel in summary["channels"]],
        signals=signals,
        rules=rules,
        facts=_facts(summary),
        metadata=_metadata(summary["metadata"]),
        lanes=lanes_of(summary["channels"], findings, span) if span else (),
        span=(_time(span[0]), _time(span[1]), _duration(span[1] - span[0])) if span else None,
        findings=_grouped(findings),
        counts=_counts(findings),
    )


def _counts(findings: Iterable[Finding]) -> dict[str, int]:
    counts: dict[str, int] = dict.fromkeys(reversed(SEVERITIES), 0)
    for finding in findings:
        counts[finding.severity] += 1
    return counts


def _grouped(findings: Iterable[Finding]) -> list[tuple[str, list[Told]]]:
    ordered = sorted(findings, key=lambda f: (f.log, f.code, f.topic, f.point))
    groups = [(severity, [_told(f) for f in ordered if f.severity == severity]) for severity in reversed(SEVERITIES)]
    return [group for group in groups if group[1]]


def _told(finding: Finding) -> Told:
    places = [text for place in finding.places[:MOST_SHOWN] if (text := _place(place))]
    numbers = [(name.replace("_", " "), _number(value)) for name, value in finding.numbers.items()]
    return Told(finding, numbers, places, max(finding.count - len(places), 0) if places else 0)


def _place(place: Place) -> str:
    parts = []
    if place.start_ns is not None:
        part = _time(place.start_ns)
        if place.end_ns is not None and place.end_ns > place.start_ns:
            part += f" for {_duration(place.end_ns - place.start_ns)}"
        parts.append(part)
    if place.first_message is not None:
        last = place.last_message if place.last_message is not None else place.first_message
        one = last == place.first_message
        parts.append(f"message {place.first_message:,}" if one else f"messages {place.first_message:,} to {last:,}")
    if place.byte_offset is not None:
        length = f", {place.byte_length:,} bytes" if place.byte_length is not None else ""
        parts.append(f"byte {place.byte_offset:,}{length}")
    return "; ".join(parts)


def _channel(channel: Mapping[str, Any]) -> dict[str, str]:
    period = channel["period_ms"]
    return {
        "topic": channel["topic"],
        "messages": f"{channel['messages']:,}",
        "rate": f"{_number(1e3 / period)}{_NO_BREAK}Hz" if period else _NOTHING,
        "jitter": _milliseconds(channel["jitter_ms"]),
        "silence": _milliseconds(channel["longest_silence_ms"]),
        "back": f"{channel['steps_back']:,}",
        "encoding": channel["message_encoding"] + ("" if channel["decodable"] else " (cannot be decoded)"),
        "schema": channel["schema_name"] or _NOTHING,
    }


def _signals(used: Mapping[str, Any]) -> tuple[list[tuple[str, str, str, str]], list[tuple[str, str]]]:
    """Rows of signal, field, unit and remark, and what holds for all of them."""
    signals = {name: value for name, value in used.items() if isinstance(value, Mapping) and name != "context"}
    rows = []
    for name, signal in {**signals, **used.get("context", {})}.items():
        remarks = [f"{key} {_plain(value)}" for key, value in signal.items() if key not in ("field", "unit")]
        rows.append((name, str(signal.get("field", "")), str(signal.get("unit", "")), ", ".join(remarks)))
    rules = [(name, _plain(value)) for name, value in used.items() if not isinstance(value, Mapping)]
    return rows, rules


def _facts(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    facts = [
        ("size", _size(summary["size_bytes"])),
        ("messages", f"{summary['messages']:,}"),
        ("compression", ", ".join(summary["compressions"]) or "none"),
        ("SHA-256", summary["sha256"]),
    ]
    for name in ("counts", "left_out", "decoded_by"):
        told = ", ".join(f"{key.replace('_', ' ')} {value:,}" for key, value in summary.get(name, {}).items() if value)
        if told:
            facts.append((name.replace("_", " ").replace("counts", "ingestion would give"), told))
    return facts


def _metadata(metadata: Mapping[str, Mapping[str, str]]) -> list[tuple[str, str, str]]:
    return [
        (record, key, value if len(value) <= _LONGEST_VALUE else f"{value[:_LONGEST_VALUE]} …")
        for record, entries in metadata.items()
        for key, value in entries.items()
    ]


def _plain(value: object) -> str:
    return " to ".join(map(_plain, value)) if isinstance(value, list | tuple) else str(value)


def _number(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return _NOTHING if value is None else str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    text = f"{value:,}" if isinstance(value, int) else f"{value:,.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
    return text.replace("-", "−")


def _milliseconds(value: float | None) -> str:
    return _NOTHING if value is None else f"{_number(float(value))}{_NO_BREAK}ms"


def _size(size_bytes: int) -> str:
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= scale:
            return f"{size_bytes / scale:.3g}{_NO_BREAK}{unit}"
    return f"{size_bytes:,}{_NO_BREAK}bytes"


def _time(t_ns: int) -> str:
    """UTC to the millisecond; a log may hold any number for a time."""
    try:
        whole = datetime.fromtimestamp(0, UTC) + timedelta(seconds=t_ns // 10**9)
    except OverflowError:
        return f"{t_ns}{_NO_BREAK}ns"
    return f"{whole:%Y-%m-%d %H:%M:%S}.{t_ns % 10**9 // 10**6:03d}{_NO_BREAK}UTC"


def _duration(span_ns: int) -> str:
    seconds = span_ns / 1e9
    if seconds < 1:
        return f"{seconds * 1e3:.4g}{_NO_BREAK}ms"
    if seconds < 120:
        return f"{seconds:.4g}{_NO_BREAK}s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:,}{_NO_BREAK}h {minutes}{_NO_BREAK}min" if hours else f"{minutes}{_NO_BREAK}min {rest}{_NO_BREAK}s"
