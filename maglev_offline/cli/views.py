"""How a look at a log reads to a person."""

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
