"""Finding the signals of a log by the names and units of its fields, or saying what to write instead."""

import re
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher

from maglev_offline.errors import LogError
from maglev_offline.logs.channels import ChannelInfo
from maglev_offline.logs.signals import UNIT_OF_SIGNAL, Signal, SignalMap

_STEMS = {
    "gap": ("gap", "air_gap"),
    "velocity": ("gap_velocity", "air_gap_velocity"),
    "current": ("coil_current", "current"),
    "voltage": ("coil_voltage", "voltage"),
    "set_point": ("set_point", "setpoint", "gap_set_point"),
    "speed_m_s": ("speed", "vehicle_speed"),
    "load_kg": ("load",),
    "chainage_m": ("chainage",),
}
"""Names that a signal goes by; the unit follows after an underscore."""

_LENGTHS = {"m": "m", "mm": "mm", "um": "um"}
_UNITS = {
    "gap": _LENGTHS,
    "velocity": {"m_s": "m/s", "mm_s": "mm/s", "um_s": "um/s"},
    "current": {"a": "A", "ma": "mA"},
    "voltage": {"v": "V", "mv": "mV"},
    "set_point": _LENGTHS,
    "speed_m_s": {"m_s": "m/s", "km_h": "km/h"},
    "load_kg": {"kg": "kg", "t": "tonne"},
    "chainage_m": {"m": "m", "km": "km"},
}

_KNOWN = {
    f"{stem}_{suffix}": (signal, unit)
    for signal, stems in _STEMS.items()
    for stem in stems
    for suffix, unit in _UNITS[signal].items()
}

_NICKNAMES = {
    "gap": ("gap", "y", "x", "position", "distance", "airgap"),
    "velocity": ("gap_velocity", "velocity", "dy", "dx", "gap_rate"),
    "current": ("current", "i", "coil_current", "amps"),
    "voltage": ("voltage", "u", "v", "coil_voltage", "volts"),
    "set_point": ("set_point", "yd", "setpoint", "reference", "target", "ref"),
}
"""What people call the signals, the likeliest first; good for a guess only."""

_NEEDED = ("gap", "current", "voltage")

_SUSPENSION = re.compile(r"/suspension/[^/]+/state")
_SUSPENSION_POINTS = r"/suspension/(?P<point>[^/]+)/state"


def detect(channels: Sequence[ChannelInfo], *, where: str = "") -> SignalMap:
    """Make a signal map from fields that are named after a signal and its unit, such as `gap_mm`.

    The last part of the dotted path counts. A topic with gap, current and voltage is a point; if there are several,
    they must spell them alike, and share what else is found on all of them.

    Raises
    ------
    LogError: there is no such topic, or they differ; it lists the channels and offers a table to paste.
    """
    found = {c.topic: _named(c) for c in channels if c.message_count}
    points = {topic: signals for topic, signals in found.items() if all(name in signals for name in _NEEDED)}
    if not points:
        raise LogError(
            "no topic has fields that are named as gap, current and voltage with their units (as gap_mm, "
            "coil_current_a and coil_voltage_v), so the signals have to be named.",
            where=where,
            todo=suggest(channels),
        )
    first, *others = points.values()
    common = {name: s for name, s in first.items() if all(other.get(name) == s for other in others)}
    if any(name not in common for name in _NEEDED):
        raise LogError(
            f"the topics {', '.join(sorted(points))} name or measure their signals differently.",
            where=where,
            todo=suggest(channels),
        )
    canonical = {name: common[name] for name in UNIT_OF_SIGNAL if name in common}
    context = {name: common[name] for name in common if name not in UNIT_OF_SIGNAL}
    return SignalMap.model_validate({"topic": _pattern(sorted(points)), "context": context, **canonical})


def describe(channels: Iterable[ChannelInfo]) -> str:
    """Channels with their numeric fields, one line each."""
    lines = []
    for channel in sorted(channels, key=lambda c: (c.topic, c.id)):
        encoding = channel.message_encoding + (f"/{channel.schema_encoding}" if channel.schema_encoding else "")
        fields = ", ".join(channel.fields) or "no numeric fields"
        if not channel.decodable:
            fields = "cannot be decoded"
        lines.append(f"  {channel.topic} ({encoding}, {channel.message_count:,} messages): {fields}")
    return "\n".join(lines) or "  (no channels)"


def suggest(channels: Sequence[ChannelInfo]) -> str:
    """What the log holds, and a `[signals]` table of best guesses, ready to paste and correct."""
    text = "The log holds:\n" + describe(channels)
    candidates = [c for c in channels if c.fields and c.message_count]
    if not candidates:
        return text
    likeliest = max(candidates, key=lambda c: (sum(_guess(c, name)[2] for name in _NEEDED), c.message_count, -c.id))
    lines = [
        "Put this into a recipe, a file such as my.toml; check every field and unit; give it with --recipe my.toml:"
    ]
    lines += ["", "[signals]"]
    lines.append(f"topic = '{_guessed_pattern(likeliest, candidates)}'")
    for name, si_unit in UNIT_OF_SIGNAL.items():
        field, unit, likeness = _guess(likeliest, name)
        if likeness == 0:
            remark = "not found: name it" if name in _NEEDED else "not found, and not needed"
            lines.append(f'# {name} = {{ field = "...", unit = "{si_unit}" }}  # {remark}')
        else:
            remark = "" if likeness == _CERTAIN else "  # a guess" if unit else "  # a guess, and the unit more so"
            lines.append(f'{name} = {{ field = "{field}", unit = "{unit or si_unit}" }}{remark}')
    return "\n".join([text, *lines, *_origin(likeliest)])


def _origin(channel: ChannelInfo) -> list[str]:
    """Tables on what a log comes from, to paste and correct; of its own it tells the period only."""
    period_ms = _mean_period_ms(channel)
    remark = "" if period_ms is None else "  # messages of the topic come so often; more where points share it"
    return [
        "",
        "# Then say what the log comes from: without these tables it is taken for a 700 kg magnet of a train,",
        "# sampled every 100 ms. The values of [plant] are those of the train: put in yours.",
        "[ingest]",
        f"grid_ms = {100 if period_ms is None else period_ms:g}{remark}",
        "",
        "[plant]",
        "mass_kg = 700  # what one magnet carries",
        "resistance_ohm = 1.2  # of its coil",
        "inductance_slope_h_m = 3.054e-3  # c in L(x) = L0 + c / (x + a), L0 = a = 0; c = 2 m g (gap / current)^2",
        "set_point_m = 0.008",
        "gap_min_m = 0.0005",
        "gap_max_m = 0.016",
    ]


def _mean_period_ms(channel: ChannelInfo) -> float | None:
    """The mean step between messages to three digits, None where there is none."""
    first, last, steps = channel.first_log_time_ns, channel.last_log_time_ns, channel.message_count - 1
    if first is None or last is None or steps < 1 or last <= first:
        return None
    return float(f"{(last - first) / steps / 1e6:.3g}")


def _named(channel: ChannelInfo) -> dict[str, Signal]:
    """Signals of one channel by name; where two fields claim a signal, the less nested one has it, or none."""
    claims: dict[str, list[tuple[int, str, str]]] = {}
    for path in channel.fields:
        parts = path.split(".")
        if parts[-1].lower() in _KNOWN and "*" not in parts:
            signal, unit = _KNOWN[parts[-1].lower()]
            claims.setdefault(signal, []).append((len(parts), path, unit))
    signals = {}
    for signal, its_claims in claims.items():
        its_claims.sort()
        if len(its_claims) == 1 or its_claims[0][0] < its_claims[1][0]:
            signals[signal] = Signal(field=its_claims[0][1], unit=its_claims[0][2])
    return signals


def _pattern(topics: Sequence[str]) -> str:
    if all(_SUSPENSION.fullmatch(topic) for topic in topics):
        return _SUSPENSION_POINTS
    return "|".join(re.escape(topic) for topic in topics)


def _guessed_pattern(likeliest: ChannelInfo, candidates: Sequence[ChannelInfo]) -> str:
    """Topics of the same fields that differ in one place only are taken for the points of one vehicle."""
    alike = sorted({c.topic for c in candidates if c.fields == likeliest.fields})
    split = [topic.split("/") for topic in alike]
    if len(alike) > 1 and len({len(parts) for parts in split}) == 1:
        differing = [k for k, parts in enumerate(zip(*split, strict=True)) if len(set(parts)) > 1]
        if len(differing) == 1:
            escaped = [re.escape(part) for part in split[0]]
            escaped[differing[0]] = "(?P<point>[^/]+)"
            return "/".join(escaped)
    return re.escape(likeliest.topic)


_CERTAIN = 3.0


def _guess(channel: ChannelInfo, signal: str) -> tuple[str, str, float]:
    """Return the likeliest field, its unit if its name tells it, and a likeness from 0 (none) to `_CERTAIN`."""
    best = ("", "", 0.0)
    for path in channel.fields:
        last = path.split(".")[-1].lower()
        known = _KNOWN.get(last)
        if known is not None:
            rating = _CERTAIN if known[0] == signal else 0.0
            unit = known[1]
        else:
            stem, unit = _without_unit(last, signal)
            if stem in _NICKNAMES[signal]:
                rating = 2.0 - 0.1 * _NICKNAMES[signal].index(stem)
            else:
                likeness = max(SequenceMatcher(None, stem, name).ratio() for name in _NICKNAMES[signal])
                told_by_unit = 0.7 if unit and signal in ("current", "voltage") else 0.0
                rating = likeness if likeness >= 0.7 else told_by_unit
        if rating > best[2] and "*" not in path:
            best = (path, unit, rating)
    return best


def _without_unit(name: str, signal: str) -> tuple[str, str]:
    for suffix, unit in sorted(_UNITS[signal].items(), key=lambda pair: -len(pair[0])):
        if name.endswith(f"_{suffix}"):
            return name.removesuffix(f"_{suffix}"), unit
    return name, ""
